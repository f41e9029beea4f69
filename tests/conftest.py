"""One BLAS thread for all tests: importing the package sets it, and it counts only
before numpy is loaded.

The small solves of the tests are two to three times slower with threads that wait for
one another.
"""

import auvid.pipeline

__all__ = ["auvid"]
