# SPDX-License-Identifier: Apache-2.0
"""Label images and sky masks for driving sets, made by ONNX networks of the user's. docs/masks.md is the manual."""
