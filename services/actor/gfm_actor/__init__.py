"""Steps environments with the newest policy and sends what happened to the replay service."""
