"""Measurement of accuracy and speed: contestants are compared, then timed in turns, and the results shown in tables and
figures.

`clock` times contestants in turns, and `compiled` makes contestants from C functions. `core` and `machine` describe the hardware,
`accuracy` and `operations` compare and count, `tables` and `drawing` show results. `models` contains shipped models of any size.
`ordernm bench`, `ordernm report` and the scripts in ``benchmarks`` use this package.
"""
