/* SPDX-License-Identifier: Apache-2.0 */
/* Empty: the files of musl/ are compiled without any processor's own ways. */
