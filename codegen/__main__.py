"""``python -m codegen`` runs ``ordernm``."""

import sys

from .entry import ordernm

if __name__ == "__main__":
    sys.exit(ordernm())
