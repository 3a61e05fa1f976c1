"""Computer vision: finds the projection screen in a camera picture and unwarps the game."""
