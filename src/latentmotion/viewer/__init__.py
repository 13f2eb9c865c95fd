"""The page that shows a motion moving."""
