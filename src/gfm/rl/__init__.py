"""MPO with Retrace: networks, losses and the learner's step as functions on tensors.

Import from the modules: `gfm.rl.policy_numpy` needs no torch, which keeps actors small.
"""
