"""Evaluators: networks that embed motions and texts, by which models are judged."""
