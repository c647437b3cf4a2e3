"""`python -m gateway` is `starter-gateway`."""

import sys

from gateway.cli.main import main

sys.exit(main())
