"""Networks, MPO, Retrace: pure functions on tensors."""
