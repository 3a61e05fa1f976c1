"""The simulated NAO: body, arms and controller."""
