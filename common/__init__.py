"""What more than one process speaks: configuration, messages, transport, metrics, the network."""
