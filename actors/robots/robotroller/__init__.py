"""A simulated robot like Keen Technologies' Robotroller: three servos at an Atari joystick."""
