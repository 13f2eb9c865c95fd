"""What a trained model is: its configurations, its card, its folder. Nothing here needs PyTorch."""
