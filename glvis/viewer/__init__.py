"""The page that is walked around in."""
