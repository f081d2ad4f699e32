"""``python -m codegen`` is ``ordernm``."""

import sys

from .entry import ordernm

if __name__ == "__main__":
    sys.exit(ordernm())
