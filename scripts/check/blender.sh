#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The add-on in Debian's Blender (a part of make check).
. "${0%/*}/common.sh"
build_addon
exec ctest --preset release -R '^(addon|blender)\.'
