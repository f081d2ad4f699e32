"""``ordernm bench``: problems with known answers, the error of a solver, and its cost.

``problems`` are data: a model, a reference with its source, goals. ``measuring`` and ``work_precision`` measure. ``command`` runs
the problems, ``results`` stores and compares results, ``lines`` and ``page`` print them; ``peers`` are other programs.
"""
