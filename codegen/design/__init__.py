"""Design tools on solvers: objectives with exact gradients, optimisation, load cases, identification, batches and sweeps.

They need SciPy, which generated packages do not; no package carries this folder.
"""
