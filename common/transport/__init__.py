"""How messages travel: requests, publications and presence over Zenoh, and who may speak."""
