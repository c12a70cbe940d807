#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Predictions of pags-bench scaling compared with measured times, on two threads of a quiet machine.
. "${0%/*}/common.sh"
build check_scaling
exec build/tests/check_scaling
