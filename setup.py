"""The compiled part, and the packages; everything else is in pyproject.toml."""

from glob import glob

import numpy
from setuptools import Extension, find_packages, setup

setup(
    packages=[*find_packages(include=["rcmqp", "rcmqp.*"]), "rcmqp.robots", "rcmqp.scenarios"],
    ext_modules=[
        Extension(
            "rcmqp._kernel",
            sources=sorted(glob("rcmqp/kernel/*.c")),
            depends=sorted(glob("rcmqp/kernel/*.h")),
            include_dirs=[numpy.get_include()],
            extra_compile_args=["-std=c99", "-fvisibility=hidden", "-O3", "-ffp-contract=off"],
        )
    ],
)
