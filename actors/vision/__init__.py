"""Seeing the game through a camera: finding the projector screen, unwarping it to 84×84."""
