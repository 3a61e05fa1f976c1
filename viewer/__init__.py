"""Looking at a robot at work, and playing through its hands oneself; needs no hub and no run."""
