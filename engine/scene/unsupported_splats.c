/* SPDX-License-Identifier: Apache-2.0 */
/* The splat formats of other programs that PAGS does not read, in one table: how each is recognised, and a remedy. */
#include "scene/other_formats.h"

#include <string.h>
#include <strings.h>

#include "base/file.h"

#define SPLAT_TRANSFORM "'@playcanvas/splat-transform' turns it into .ply"
#define FROM_THE_PROGRAM "export a .ply or .spz from the program that made it"
#define TILES "give one of its tiles, a .glb with KHR_gaussian_splatting"
#define NO_SPLATS "a file of splats has KHR_gaussian_splatting or is a .ply, .spz, .sog or .splat"

typedef struct unsupported_format {
  const char *name;    /* of the file, or its extension with the dot */
  const char *magic;   /* its first bytes; NULL: not distinctive */
  const char *keys[2]; /* two keys of the root of its JSON; NULL: no JSON */
  const char *what, *remedy;
} unsupported_format;

static const unsupported_format formats[] = {
    {".ksplat", NULL, {NULL}, "the format of the viewer GaussianSplats3D (.ksplat)", SPLAT_TRANSFORM},
    {".lcc", NULL, {"totalSplats", "cellLengthX"}, "LCC, the format of XGRIDS (.lcc)", SPLAT_TRANSFORM},
    {".lcc2", NULL, {NULL}, "LCC 2, the format of XGRIDS (.lcc2)", SPLAT_TRANSFORM},
    {".rad", "RAD0", {NULL}, "RAD, the streamed levels of the viewer Spark (.rad)", FROM_THE_PROGRAM},
    {".spx", "spx", {NULL}, "SPX, the format of the viewer Reall3D (.spx)", "its tool gsbox turns it into .ply"},
    {".splatv", NULL, {NULL}, "splats that move, of the viewer splaTV (.splatv)", FROM_THE_PROGRAM},
    {".ssproj", NULL, {NULL}, "a project of SuperSplat (.ssproj)", "export a .ply or .sog from SuperSplat"},
    {".psht", NULL, {NULL}, "a project of Postshot (.psht)", "export a .ply from Postshot"},
    {"lod-meta.json",
     NULL,
     {"lodLevels", "filenames"},
     "the list of a streamed SOG (lod-meta.json)",
     "PAGS doesn't put its parts together: give one of them, such as the meta.json of a folder next to it"},
    {"tileset.json", NULL, {"root", "geometricError"}, "a tileset of 3D Tiles (tileset.json)", TILES},
    {".b3dm", "b3dm", {NULL}, "a tile of 3D Tiles 1.0 (.b3dm)", NO_SPLATS},
    {".pnts", "pnts", {NULL}, "a tile of 3D Tiles 1.0 (.pnts)", NO_SPLATS},
    {".usdc", "PXR-USDC", {NULL}, "a USD stage (.usdc)", FROM_THE_PROGRAM},
    {".usda", "#usda ", {NULL}, "a USD stage (.usda), which PAGS writes only", FROM_THE_PROGRAM},
    {".usdz", NULL, {NULL}, "a USD stage (.usdz), which PAGS writes only", FROM_THE_PROGRAM},
    {".ckpt",
     NULL,
     {NULL},
     "a checkpoint of PyTorch (.ckpt)",
     "`ns-export gaussian-splat` writes a .ply of nerfstudio's"},
    {".pth", NULL, {NULL}, "a checkpoint of PyTorch (.pth)", FROM_THE_PROGRAM},
    {".pt", NULL, {NULL}, "a checkpoint of PyTorch (.pt)", FROM_THE_PROGRAM},
};

enum { FORMATS = sizeof formats / sizeof *formats };

static bool has_name(const unsupported_format *f, const char *path) {
  return strcasecmp(f->name, f->name[0] == '.' ? pags_path_extension(path) : pags_path_name(path)) == 0;
}

static pags_result refuse(const char *path, const unsupported_format *f) {
  return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s: is %s, which can't be read; %s", path, f->what, f->remedy);
}

pags_result pags_unsupported_splats_check(const char *path, const uint8_t *bytes, size_t size,
                                          const pags_json_value *root) {
  for (int i = 0; i < FORMATS; i++) {
    const unsupported_format *f = &formats[i];
    const bool magic = f->magic && size >= strlen(f->magic) && memcmp(bytes, f->magic, strlen(f->magic)) == 0;
    if (magic || (root && f->keys[0] && pags_json_member(root, f->keys[0]) && pags_json_member(root, f->keys[1])))
      return refuse(path, f);
  }
  for (int i = 0; i < FORMATS; i++)
    if (has_name(&formats[i], path))
      return refuse(path, &formats[i]);
  return PAGS_OK;
}

pags_result pags_unsupported_splats_check_folder(const char *folder) {
  PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = {0};
  PAGS_TRY(pags_dir_list_read(folder, &list));
  for (int64_t i = 0; i < list.count; i++)
    for (int k = 0; k < FORMATS; k++)
      if (has_name(&formats[k], list.names[i]))
        return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s: holds %s, %s, which can't be read; %s", folder, list.names[i],
                         formats[k].what, formats[k].remedy);
  return PAGS_OK;
}
