"""Adds the folder of tests to the path, since tests of several folders import `random_models`."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
