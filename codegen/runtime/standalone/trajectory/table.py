"""A trajectory as a pandas DataFrame; pandas is imported only if a table is requested."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..arrays import Array


def dataframe(t: Array, columns: Mapping[str, Array]) -> Any:
    """A pandas.DataFrame of columns (nt,) over the times t (nt,)."""
    try:
        import pandas
    except ImportError as error:
        raise ImportError(
            'to_dataframe needs pandas: pip install "ordernm[dataframe]", or pip install pandas'
        ) from error
    return pandas.DataFrame(dict(columns), index=pandas.Index(t, name="t"))
