# SPDX-License-Identifier: Apache-2.0
"""Tests of tools/ need packages that the system's Python may lack: runs such a test with the tools' own Python environment."""

import importlib.util
import os
import sys

TOOLS = os.path.join(os.path.dirname(os.path.dirname(os.path.abspath(__file__))), "tools")


def need(tool, *modules):
    """Restarts the test with the environment of a tool unless these modules are here, or skips it with exit code 77."""
    if all(importlib.util.find_spec(name) for name in modules):
        return
    python = os.path.join(TOOLS, tool, ".venv", "bin", "python")
    if os.path.exists(python) and os.environ.get("TOOL_PYTHON") != "own":
        os.execve(python, [python, "-B", *sys.argv], os.environ | {"TOOL_PYTHON": "own"})
    print(f"skipped: needs {', '.join(modules)}; make setup puts them into tools/{tool}/.venv")
    sys.exit(77)
