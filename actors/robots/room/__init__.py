"""The room around any robot: screen, projector, camera, views for people, and physics client."""
