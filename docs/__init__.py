"""What writes pages and builds the site; nothing of it is installed."""
