/* SPDX-License-Identifier: Apache-2.0 */
/* Extension records of SPZ files: a type, a length in bytes, then as many bytes. */
#ifndef PAGS_SCENE_SPZ_RECORDS_H
#define PAGS_SCENE_SPZ_RECORDS_H

/* SPZ_ADOBE_coordinate_system (nianticlabs/spz, extensions/README.md): one u32, a pags_axes. */
#define PAGS_SPZ_AXES_RECORD 0xADBE0003u

/* PAGS' own: the up axis of the scene in PLY's axes (u32, a pags_up), and its origin (three doubles). */
#define PAGS_SPZ_SCENE_RECORD 0x50470001u
enum { PAGS_SPZ_SCENE_BYTES = 28 };

/* PAGS' own: converted_from of pags_splat_facts (f32). */
#define PAGS_SPZ_CUT_RECORD 0x50470002u

#endif
