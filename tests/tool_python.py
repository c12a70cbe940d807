# SPDX-License-Identifier: Apache-2.0
"""Runs a test of tools/ with the tool's Python environment, as the test needs packages that the system's Python may
lack."""

import importlib.util
import os
import sys

TOOLS = os.path.join(os.path.dirname(os.path.dirname(os.path.abspath(__file__))), "tools")


def need(tool, *modules):
    """Restarts the test with a tool's environment unless these modules can be imported; without one, skips it with
    exit code 77."""
    if all(importlib.util.find_spec(name) for name in modules):
        return
    python = os.path.join(TOOLS, tool, ".venv", "bin", "python")
    if os.path.exists(python) and os.environ.get("TOOL_PYTHON") != "own":
        os.execve(python, [python, "-B", *sys.argv], os.environ | {"TOOL_PYTHON": "own"})
    print(f"skipped: needs {', '.join(modules)}; make setup puts them into tools/{tool}/.venv")
    sys.exit(77)
