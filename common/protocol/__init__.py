"""What processes say to each other: messages, each declared once with its bounds, and weights."""
