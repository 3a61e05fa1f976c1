"""Shows a robot at work, and lets a person play through its hands, without a hub or a run."""
