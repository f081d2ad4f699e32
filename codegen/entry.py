"""Entry points of the commands. These functions import the commands, so that Ctrl-C during the import causes no
traceback."""

import sys


def ordernm() -> int:
    """Runs ``ordernm COMMAND``."""
    try:
        from .cli import main

        return main()
    except KeyboardInterrupt:
        return _interrupted("ordernm")


def generate() -> int:
    """Runs ``generate MODEL``."""
    try:
        from .cli import generate_main

        return generate_main()
    except KeyboardInterrupt:
        return _interrupted("generate")


def _interrupted(command: str) -> int:
    sys.stderr.write(f"{command}: interrupted before it began\n")
    return 130
