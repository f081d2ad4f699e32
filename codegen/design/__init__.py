"""Design tools on solvers: objectives with exact gradients, optimisation, load cases, identification, batches and sweeps.

These tools need SciPy. Generated packages do not need SciPy, so they do not contain this folder.
"""
