"""``ordernm bench``: problems with known answers, how near a solver comes to them and what that takes.

``problems`` are data: a model, a reference with its source, what is asked. ``timing`` and ``work_precision`` measure, ``running``
goes over problems, ``results`` keeps and compares what was found, ``lines`` and ``page`` print it; ``peers`` are other programs.
"""
