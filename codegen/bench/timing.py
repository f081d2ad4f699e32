"""Former name of `codegen.measure.clock`; it will be removed in the next version."""

import warnings

from ..measure.clock import Seconds, Timed, alternate, calibrated, elapsed, one_core, summary, turns

warnings.warn("ordernm.bench.timing is now ordernm.measure.clock", DeprecationWarning, stacklevel=2)

__all__ = ["Seconds", "Timed", "alternate", "calibrated", "elapsed", "one_core", "summary", "turns"]
