"""A robot that is being driven, as viewers see it: Foxglove and Rerun."""
