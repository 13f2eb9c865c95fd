"""What several tests share: made-up people, files and folders, tiny models."""
