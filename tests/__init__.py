"""The tests. The version has no commit here: a record is the same in a checkout and in a copy of it."""

import gateway

gateway.__version__ = gateway.__version__.partition("+")[0]
