"""One port for messages between processes, two adapters: zenoh and in-memory."""
