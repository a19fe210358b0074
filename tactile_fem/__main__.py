"""``python -m tactile_fem`` is the command ``tactile-fem``."""

import sys

from tactile_fem.cli.app import main

if __name__ == "__main__":
    sys.exit(main())
