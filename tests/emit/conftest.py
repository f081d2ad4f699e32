"""Puts the tests' folder on the path: `random_models` is shared by the tests of every floor."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
