# SPDX-License-Identifier: Apache-2.0
"""Makes label images and sky masks for driving sets with ONNX networks that the user provides. docs/masks.md is the
manual."""
