"""The page that shows a result in a browser."""
