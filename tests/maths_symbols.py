#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""maths_symbols.py LIBRARY...: lists the functions of <math.h> that built libraries import from the system, and
fails if one of them isn't exact by definition. Other functions differ between C libraries and processors, so the
engine compiles in its own (engine/maths)."""

import subprocess
import sys

# IEEE 754 or C define the results of these functions to the bit, so every system gives the same.
EXACT = {name + kind for name in "sqrt fabs floor ceil rint fmod fmin fmax ldexp frexp".split() for kind in ("", "f")}

# All functions of C17's <math.h>, and those that glibc adds.
FUNCTIONS = """acos asin atan atan2 cos sin tan acosh asinh atanh cosh sinh tanh exp exp2 expm1 frexp ilogb ldexp log log10 log1p log2 logb modf scalbn
scalbln cbrt fabs hypot pow sqrt erf erfc lgamma tgamma ceil floor nearbyint rint lrint llrint round lround llround trunc fmod remainder remquo
copysign nan nextafter nexttoward fdim fmax fmin fma sincos exp10 pow10 gamma lgamma_r j0 j1 jn y0 y1 yn scalb significand drem""".split()
KNOWN = {name + kind for name in FUNCTIONS for kind in ("", "f", "l")}


# Object files that may import more functions, with the reason.
EXCEPTIONS = {
    "subdiv.cc.o": {"sin", "cos", "sincos"}
}  # OpenSubdiv's headers compute masks of limit tangents, which pags doesn't use

# libwebp, linked into shared libraries, calls these functions: its encoder estimates file sizes by them. Decoded
# pictures don't depend on them. The engine's object files are checked in their static libraries.
LIBWEBP = {"log", "log10", "pow"}


def asked_of_the_system(path):
    names = set()
    for option in (["-u"], ["-u", "-D"]):
        output = subprocess.run(["nm", "-A", *option, path], capture_output=True, text=True).stdout
        for line in output.splitlines():
            place, _, rest = line.rpartition(": ")
            words = rest.split()
            if len(words) == 2 and words[0] in "Uw":
                name = words[1].split("@")[0]
                # glibc's wrappers for finite arguments, which -ffinite-math-only would call
                name = name.removeprefix("__").removesuffix("_finite")
                if name not in EXCEPTIONS.get(place.split(":")[-1], ()):
                    names.add(name)
    shared = ".so" in path.rsplit("/", 1)[-1]
    return (names - LIBWEBP if shared else names) & KNOWN


def main():
    wrong = 0
    for path in sys.argv[1:]:
        names = asked_of_the_system(path)
        others = sorted(names - EXACT)
        wrong += len(others)
        print(f"{path}: {' '.join(sorted(names)) or 'none'}" + (f"; NOT EXACT: {' '.join(others)}" if others else ""))
    print(f"maths_symbols: {len(sys.argv) - 1} files, {wrong} functions that are not exact")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
