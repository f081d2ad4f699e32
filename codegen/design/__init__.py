"""Design tools on solvers: objectives with exact gradients, optimisation, load cases, identification, batches and sweeps.

They need SciPy. Generated packages do not need it, so they do not contain this folder.
"""
