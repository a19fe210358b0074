"""The build backend: setuptools, once Python is new enough.

With an older Python, pip's first message would be that it finds no DOLFINx.
"""

import sys

if sys.version_info < (3, 12):  # noqa: UP036
    sys.exit("tactile-fem needs Python >= 3.12: this is {}.{}.".format(*sys.version_info))

from setuptools.build_meta import *  # noqa: F403
