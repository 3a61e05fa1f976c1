"""The command lines of all programs, and the errors about their flags."""
