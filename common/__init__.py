"""What more than one process speaks: configuration, messages, the Zenoh session, the network."""
