"""Code that several processes share: configuration, messages, transport, metrics, the network."""
