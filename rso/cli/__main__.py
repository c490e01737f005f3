"""`python -m rso.cli`."""

import sys

from rso.cli import main

sys.exit(main())
