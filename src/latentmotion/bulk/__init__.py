"""Bulk generation: motions of many prompts, in shards that any number of processes make."""
