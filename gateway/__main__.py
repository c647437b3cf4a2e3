"""`python -m gateway` is `starter-gateway`."""

import sys

from gateway.cli import main

sys.exit(main())
