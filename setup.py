"""The compiled part, and the packages; everything else is in pyproject.toml."""

import os
import shutil
import sysconfig
from glob import glob

import numpy
from setuptools import Extension, find_packages, setup
from setuptools.command.build_ext import build_ext
from setuptools.errors import CompileError, PlatformError

GNU = ["-std=c99", "-fvisibility=hidden", "-O3", "-ffp-contract=off"]
MSVC = ["/std:c11", "/O2", "/fp:precise", "/D_USE_MATH_DEFINES"]
TOOLS = (
    "rcmqp has a kernel in C, and {} is missing; install it (Debian and Ubuntu: apt install "
    "build-essential python3-dev; macOS: xcode-select --install; Windows: Build Tools for Visual "
    "Studio, with C++), then try again"
)


class Build(build_ext):
    """Flags of the compiler that is here; without one, the last line says what to install."""

    def build_extension(self, ext):
        """Compile it."""
        ext.extra_compile_args = MSVC if self.compiler.compiler_type == "msvc" else GNU
        try:
            super().build_extension(ext)
        except (CompileError, PlatformError) as error:
            if self.compiler.compiler_type == "msvc":  # raises PlatformError if it is not found
                missing = isinstance(error, PlatformError)
            else:
                command = getattr(self.compiler, "compiler_so", None)
                missing = not command or shutil.which(command[0]) is None
            if missing:
                raise PlatformError(TOOLS.format("a C compiler")) from error
            if not os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")):
                raise PlatformError(TOOLS.format("Python.h")) from error
            raise


setup(
    packages=[*find_packages(include=["rcmqp", "rcmqp.*"]), "rcmqp.robots", "rcmqp.scenarios"],
    cmdclass={"build_ext": Build},
    ext_modules=[
        Extension(
            "rcmqp._kernel",
            sources=sorted(glob("rcmqp/kernel/*.c")),
            depends=sorted(glob("rcmqp/kernel/*.h")),
            include_dirs=[numpy.get_include()],
        )
    ],
)
