"""Code that this machine's own C++ compiler builds when it is first needed."""
