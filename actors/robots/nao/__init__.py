"""The simulated room: the NAO, its controller, the projector, the camera and the physics."""
