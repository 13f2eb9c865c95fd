"""The web page that plays motions."""
