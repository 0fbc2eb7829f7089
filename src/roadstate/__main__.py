"""``python -m roadstate``: the command line."""

import sys

from roadstate.cli import main

sys.exit(main())
