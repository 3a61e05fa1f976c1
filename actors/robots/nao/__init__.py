"""The simulated NAO in its room: body, arms, controller, projector, camera and physics."""
