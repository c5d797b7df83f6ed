"""``python -m swimmer_mj`` is ``swimmer-mj``."""

import sys

from swimmer_mj.cli import main

if __name__ == "__main__":
    sys.exit(main())
