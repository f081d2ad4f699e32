"""``python -m codegen`` is ``ordernm``."""

import sys

from .cli import main

sys.exit(main())
