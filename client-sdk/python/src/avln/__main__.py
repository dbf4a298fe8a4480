"""`python -m avln`."""

import sys

from avln.cli import main

sys.exit(main())
