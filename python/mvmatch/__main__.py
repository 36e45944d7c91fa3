"""`python -m mvmatch` is the command line."""

import sys

from mvmatch.cli import main

sys.exit(main())
