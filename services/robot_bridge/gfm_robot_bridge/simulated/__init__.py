"""A simulated Sawyer in a process of its own, with effects that its nominal model lacks.

It stands in for a real robot and therefore shares no law, integrator or time step with the code
that diagnoses it: only the arm's published geometry and inertias.
"""
