"""``ordernm bench``: problems with known answers, how near a solver comes to them and what that takes.

``problems`` are data: a model, a reference with its source, goals. ``measuring`` and ``work_precision`` measure, ``command`` runs
the problems, ``results`` keeps and compares results, ``lines`` and ``page`` print them; ``peers`` are other programs.
"""
