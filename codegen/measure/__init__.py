"""How anything is measured: contestants that take turns, compared before they are timed, and their tables and figures.

``clock`` lets contestants take turns, ``compiled`` makes contestants of C functions, ``core`` and ``machine`` say on what they
run, ``accuracy`` and ``operations`` compare and count, ``tables`` and ``drawing`` show; ``models`` has shipped
models of any size.
`ordernm bench`, `ordernm report` and the scripts in ``benchmarks`` stand on this.
"""
