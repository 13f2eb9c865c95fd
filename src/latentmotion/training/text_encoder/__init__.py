"""The small text encoder, distilled from a large one."""
