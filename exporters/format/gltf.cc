/* SPDX-License-Identifier: Apache-2.0 */
/* Builds glTF 2.0 files with tinygltf behind the C interface of gltf.h. This is the only file that includes tinygltf;
 * every C++ exception is caught here and becomes a failure. */
#include "exporters/format/gltf.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <new>
#include <set>
#include <sstream>
#include <stdexcept>
#include <string>
#include <unordered_map>
#include <vector>

#include <strings.h>
#include <tiny_gltf.h>

#include "base/file.h"
#include "base/json.h"
#include "base/memory.h"
#include "base/text.h"
#include "exporters/format/bake.h"
#include "maths/maths.h"

struct pags_gltf {
  tinygltf::Model model;
  std::vector<unsigned char> bytes;
  std::set<std::string> nodes, meshes, cameras; /* names that are taken */
  bool failed = false;
};

namespace {

/* Calls `what`, which may throw, and returns its result; on an exception, or after an earlier failure, it sets
 * `failed` and returns -1. `what` is of a template type, since the construction of a std::function could throw before
 * the try. */
template <typename Work>
int guarded(pags_gltf *gltf, const Work &what) {
  if (gltf->failed)
    return -1;
  try {
    return what();
  } catch (...) {
    gltf->failed = true;
    return -1;
  }
}

/* The same for work without a result. */
template <typename Work>
void attempt(pags_gltf *gltf, const Work &what) {
  guarded(gltf, [&] {
    what();
    return 0;
  });
}

/* Appends an item and returns its index. */
template <typename Item>
int append(std::vector<Item> &list, const Item &item) {
  list.push_back(item);
  return static_cast<int>(list.size()) - 1;
}

/* Text for the file, which has to be UTF-8. */
std::string readable(const char *text) {
  const std::unique_ptr<char, void (*)(void *)> copy(pags_text_readable(text), std::free);
  if (!copy)
    throw std::bad_alloc();
  return std::string(copy.get());
}

/* Makes a name unique: importers identify objects by name, and may overwrite one with another. */
std::string unique(std::set<std::string> &taken, const char *name) {
  const std::string wanted = *name ? readable(name) : "unnamed";
  std::string out = wanted;
  for (int i = 2; !taken.insert(out).second; i++)
    out = wanted + "_" + std::to_string(i);
  return out;
}

tinygltf::Value convert(const pags_json_value *value) {
  switch (value->type) {
    case PAGS_JSON_BOOL: return tinygltf::Value(value->boolean);
    case PAGS_JSON_NUMBER:
      if (!std::strpbrk(value->text, ".eE") && std::fabs(value->number) < 2e9)
        return tinygltf::Value(static_cast<int>(value->number));
      return tinygltf::Value(value->number);
    case PAGS_JSON_STRING: return tinygltf::Value(readable(value->text));
    case PAGS_JSON_ARRAY: {
      tinygltf::Value::Array array;
      for (const pags_json_value *child = value->first; child; child = child->next)
        array.push_back(convert(child));
      return tinygltf::Value(array);
    }
    case PAGS_JSON_OBJECT: {
      tinygltf::Value::Object object;
      for (const pags_json_value *child = value->first; child; child = child->next)
        if (child->type != PAGS_JSON_NULL)
          object[readable(child->key)] = convert(child);
      return tinygltf::Value(object);
    }
    default: return tinygltf::Value();
  }
}

tinygltf::Value parse(const char *text) {
  pags_json *json = nullptr;
  if (pags_json_parse_text("extras", text, std::strlen(text), &json) != PAGS_OK)
    throw std::runtime_error("json");
  const std::unique_ptr<pags_json, void (*)(pags_json *)> owner(json, pags_json_destroy);
  return convert(pags_json_root(json));
}

/* ---- The buffer and its accessors ---- */

/* Appends `size` bytes to the buffer at a multiple of 4 bytes and adds a bufferView of them; returns its index. */
int put_view(pags_gltf *gltf, const void *data, size_t size, int target, size_t stride) {
  gltf->bytes.resize((gltf->bytes.size() + 3) / 4 * 4);
  tinygltf::BufferView view;
  view.buffer = 0;
  view.byteOffset = gltf->bytes.size();
  view.byteLength = size;
  view.byteStride = stride;
  view.target = target;
  const unsigned char *begin = static_cast<const unsigned char *>(data);
  gltf->bytes.insert(gltf->bytes.end(), begin, begin + size);
  return append(gltf->model.bufferViews, view);
}

int put_accessor(pags_gltf *gltf, int view, int component, int type, size_t count, bool normalized = false) {
  tinygltf::Accessor accessor;
  accessor.bufferView = view;
  accessor.componentType = component;
  accessor.type = type;
  accessor.count = count;
  accessor.normalized = normalized;
  return append(gltf->model.accessors, accessor);
}

/* The values of a vertex attribute or, with `target` 0, of an animation. */
int put_floats(pags_gltf *gltf, const float *values, size_t count, int components, bool bounds,
               int target = TINYGLTF_TARGET_ARRAY_BUFFER) {
  static const int types[] = {TINYGLTF_TYPE_SCALAR, TINYGLTF_TYPE_VEC2, TINYGLTF_TYPE_VEC3, TINYGLTF_TYPE_VEC4};
  size_t width = static_cast<size_t>(components);
  int view = put_view(gltf, values, count * width * 4, target, 0);
  int index = put_accessor(gltf, view, TINYGLTF_COMPONENT_TYPE_FLOAT, types[width - 1], count);
  tinygltf::Accessor &accessor = gltf->model.accessors.back();
  for (size_t k = 0; k < width && bounds; k++) {
    float lo = values[k], hi = values[k];
    for (size_t i = 0; i < count; i++) {
      lo = std::min(lo, values[i * width + k]);
      hi = std::max(hi, values[i * width + k]);
    }
    accessor.minValues.push_back(static_cast<double>(lo));
    accessor.maxValues.push_back(static_cast<double>(hi));
  }
  return index;
}

int put_indices(pags_gltf *gltf, const uint32_t *triangles, size_t count, size_t vertices) {
  if (vertices < 65535) {
    std::vector<uint16_t> narrow(triangles, triangles + count);
    return put_accessor(gltf, put_view(gltf, narrow.data(), 2 * count, TINYGLTF_TARGET_ELEMENT_ARRAY_BUFFER, 0),
                        TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT, TINYGLTF_TYPE_SCALAR, count);
  }
  return put_accessor(gltf, put_view(gltf, triangles, 4 * count, TINYGLTF_TARGET_ELEMENT_ARRAY_BUFFER, 0),
                      TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT, TINYGLTF_TYPE_SCALAR, count);
}

int put_colors(pags_gltf *gltf, const float *colors, size_t count) {
  std::vector<uint16_t> values(4 * count);
  for (size_t i = 0; i < count; i++) {
    for (size_t c = 0; c < 3; c++)
      values[4 * i + c] =
          static_cast<uint16_t>((long)pags_round(65535 * pags_splat_linear(static_cast<double>(colors[3 * i + c]))));
    values[4 * i + 3] = 65535;
  }
  int view = put_view(gltf, values.data(), 8 * count, TINYGLTF_TARGET_ARRAY_BUFFER, 0);
  return put_accessor(gltf, view, TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT, TINYGLTF_TYPE_VEC4, count, true);
}

int put_places(pags_gltf *gltf, const std::vector<float> &uv) {
  std::vector<uint16_t> values;
  for (const float place : uv)
    values.push_back(static_cast<uint16_t>((long)pags_round(65535 * static_cast<double>(place))));
  int view = put_view(gltf, values.data(), 2 * values.size(), TINYGLTF_TARGET_ARRAY_BUFFER, 0);
  return put_accessor(gltf, view, TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT, TINYGLTF_TYPE_VEC2, uv.size() / 2, true);
}

/* ---- Textures ---- */

/* A mesh with a vertex for each chart that a vertex is in, and indices that name these, and that name for all of them
 * the first. */
struct Charted {
  std::vector<float> positions, normals, uv;
  std::vector<uint32_t> each, merged;
};

Charted charted(const pags_proxy_mesh *surface, const std::vector<float> &normals, const pags_texture *texture) {
  std::vector<uint32_t> first(static_cast<size_t>(surface->vertex_count), UINT32_MAX);
  std::unordered_map<uint64_t, uint32_t> known;
  Charted out;
  for (size_t i = 0; i < 3 * static_cast<size_t>(surface->triangle_count); i++) {
    const size_t vertex = surface->triangles[i];
    const uint32_t added = static_cast<uint32_t>(out.uv.size() / 2);
    const auto found =
        known.emplace(static_cast<uint64_t>(texture->chart_of[i / 3]) << 32 | surface->triangles[i], added);
    if (found.second) {
      out.positions.insert(out.positions.end(), surface->positions + 3 * vertex, surface->positions + 3 * vertex + 3);
      out.normals.insert(out.normals.end(), normals.data() + 3 * vertex, normals.data() + 3 * vertex + 3);
      out.uv.insert(out.uv.end(), texture->uv + 2 * i, texture->uv + 2 * i + 2);
    }
    out.each.push_back(found.first->second);
    first[vertex] = std::min(first[vertex], found.first->second);
    out.merged.push_back(first[vertex]);
  }
  return out;
}

/* The index of the texture of the file, which is added when it is first asked for. */
int put_texture(pags_gltf *gltf, const pags_atlas *atlas) {
  if (!gltf->model.textures.empty())
    return 0;
  tinygltf::Image image;
  tinygltf::Texture use;
  image.name = "atlas";
  image.mimeType = "image/jpeg";
  image.bufferView = put_view(gltf, atlas->jpeg, atlas->jpeg_size, 0, 0);
  use.source = append(gltf->model.images, image);
  return append(gltf->model.textures, use);
}

/* Adds a mesh of one primitive. */
int put_mesh(pags_gltf *gltf, const char *name, const tinygltf::Primitive &primitive,
             const tinygltf::ExtensionMap &extensions = {}) {
  tinygltf::Mesh mesh;
  mesh.name = unique(gltf->meshes, name);
  mesh.primitives.push_back(primitive);
  mesh.extensions = extensions;
  return append(gltf->model.meshes, mesh);
}

/* ---- Nodes and animation ---- */

void use_extension(pags_gltf *gltf, const std::string &name) {
  std::vector<std::string> &used = gltf->model.extensionsUsed;
  if (std::find(used.begin(), used.end(), name) == used.end())
    used.push_back(name);
}

/* The rotation of a rigid pose (3x4, row-major) as a unit quaternion in glTF's order x, y, z, w. */
std::vector<double> quaternion(const double pose[12]) {
  const double r[9] = {pose[0], pose[1], pose[2], pose[4], pose[5], pose[6], pose[8], pose[9], pose[10]};
  double q[4];
  pags_quaternion_from_rotation(r, q);
  double length = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  return {q[1] / length, q[2] / length, q[3] / length, q[0] / length};
}

tinygltf::Node &node_at(pags_gltf *gltf, int node) {
  return gltf->model.nodes.at(static_cast<size_t>(node));
}

void add_channel(pags_gltf *gltf, int node, int input, int output, const char *path) {
  tinygltf::Animation &animation = gltf->model.animations.front();
  tinygltf::AnimationSampler sampler;
  sampler.input = input;
  sampler.output = output;
  tinygltf::AnimationChannel channel;
  channel.sampler = append(animation.samplers, sampler);
  channel.target_node = node;
  channel.target_path = path;
  animation.channels.push_back(channel);
}

/* ---- Saving ---- */

std::string serialize(pags_gltf *gltf) {
  tinygltf::TinyGLTF writer;
  std::ostringstream stream(std::ios::binary);
  gltf->model.buffers.clear();
  if (!gltf->bytes.empty()) {
    gltf->model.buffers.emplace_back();
    gltf->model.buffers[0].data.swap(gltf->bytes);
  }
  if (!writer.WriteGltfSceneToStream(&gltf->model, stream, false, true))
    throw std::runtime_error("write");
  return stream.str();
}

uint32_t word_at(const std::string &bytes, size_t at) {
  uint32_t word;
  std::memcpy(&word, bytes.data() + at, 4);
  return word;
}

/* A file name as a URI: all but letters, digits and "-._~" in percent-encoding. */
std::string uri_of(const char *name) {
  std::string uri;
  for (; *name; name++) {
    char code[4];
    const unsigned char c = static_cast<unsigned char>(*name);
    const bool plain =
        (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || std::strchr("-._~", c);
    std::snprintf(code, sizeof code, plain ? "%c" : "%%%02X", c);
    uri += code;
  }
  return uri;
}

/* Writes a GLB in memory as a .gltf and a .bin. A GLB is a header of 12 bytes and chunks of (length, kind, bytes):
 * first the JSON, then the buffer. The name of the .bin is put into the JSON as the buffer's `uri`. */
pags_result save_apart(const std::string &glb, const char *path) {
  std::string bin_path(path);
  bin_path.replace(bin_path.size() - 5, 5, ".bin");
  size_t json_size = word_at(glb, 12), bin_at = 20 + json_size;
  std::string json = glb.substr(20, json_size);
  while (!json.empty() && json.back() == ' ')
    json.pop_back();
  const std::string mark = "\"buffers\":[{"; /* quotes in JSON strings are escaped, so only the member matches */
  size_t at = json.find(mark);
  if (at != std::string::npos) {
    json.insert(at + mark.size(), "\"uri\":\"" + uri_of(pags_path_name(bin_path.c_str())) + "\",");
    size_t bin_size = word_at(glb, bin_at);
    PAGS_TRY(pags_file_write(bin_path.c_str(), glb.data() + bin_at + 8, bin_size));
  }
  return pags_file_write(path, json.data(), json.size());
}

} /* namespace */

extern "C" {

pags_result pags_gltf_create(pags_gltf **out) {
  *out = nullptr;
  try {
    *out = new pags_gltf;
    tinygltf::Model &model = (*out)->model;
    model.asset.generator = "pags " PAGS_VERSION_STRING;
    model.scenes.emplace_back();
    model.scenes[0].name = "scene";
    model.defaultScene = 0;
    return PAGS_OK;
  } catch (...) {
    delete *out;
    *out = nullptr;
    return pags_out_of_memory("a glTF file");
  }
}

void pags_gltf_destroy(pags_gltf *gltf) {
  delete gltf;
}

int pags_gltf_material(pags_gltf *gltf, const char *name, bool double_sided, const pags_atlas *atlas) {
  return guarded(gltf, [&] {
    tinygltf::Material material;
    material.name = readable(name);
    material.doubleSided = double_sided;
    material.pbrMetallicRoughness.metallicFactor = 0;
    if (atlas && atlas->jpeg)
      material.pbrMetallicRoughness.baseColorTexture.index = put_texture(gltf, atlas);
    return append(gltf->model.materials, material);
  });
}

int pags_gltf_mesh(pags_gltf *gltf, const char *name, const pags_proxy_mesh *surface, const pags_texture *texture,
                   int material, int flags) {
  return guarded(gltf, [&] {
    const size_t vertices = static_cast<size_t>(surface->vertex_count),
                 corners = 3 * static_cast<size_t>(surface->triangle_count);
    const bool textured = texture && texture->uv;
    std::vector<float> normals(3 * vertices);
    if (flags & PAGS_GLTF_NORMALS)
      pags_proxy_mesh_normals(surface, normals.data());
    tinygltf::Primitive primitive;
    primitive.mode = TINYGLTF_MODE_TRIANGLES;
    primitive.material = material;
    const Charted own = textured ? charted(surface, normals, texture) : Charted();
    const size_t count = textured ? own.uv.size() / 2 : vertices;
    primitive.attributes["POSITION"] =
        put_floats(gltf, textured ? own.positions.data() : surface->positions, count, 3, true);
    if (flags & PAGS_GLTF_NORMALS)
      primitive.attributes["NORMAL"] =
          put_floats(gltf, textured ? own.normals.data() : normals.data(), count, 3, false);
    if (textured)
      primitive.attributes["TEXCOORD_0"] = put_places(gltf, own.uv);
    else if (!(flags & PAGS_GLTF_BARE))
      primitive.attributes["COLOR_0"] = put_colors(gltf, surface->colors, vertices);
    primitive.indices = put_indices(gltf, textured ? own.each.data() : surface->triangles, corners, count);
    tinygltf::ExtensionMap extensions;
    if (flags & PAGS_GLTF_MANIFOLD) {
      /* EXT_mesh_manifold asks for indices by which faces share vertices. Those of a mesh without a texture do. */
      tinygltf::Value::Object shared, manifold, position;
      position["POSITION"] = tinygltf::Value(primitive.attributes["POSITION"]);
      shared["attributes"] = tinygltf::Value(position);
      shared["indices"] =
          tinygltf::Value(textured ? put_indices(gltf, own.merged.data(), corners, count) : primitive.indices);
      shared["mode"] = tinygltf::Value(TINYGLTF_MODE_TRIANGLES);
      manifold["manifoldPrimitive"] = tinygltf::Value(shared);
      extensions["EXT_mesh_manifold"] = tinygltf::Value(manifold);
      use_extension(gltf, "EXT_mesh_manifold");
    }
    return put_mesh(gltf, name, primitive, extensions);
  });
}

int pags_gltf_points(pags_gltf *gltf, const char *name, int64_t count, const pags_gltf_attribute *attributes,
                     int attribute_count, const char *extension, const char *extension_json) {
  return guarded(gltf, [&] {
    tinygltf::Primitive primitive;
    primitive.mode = TINYGLTF_MODE_POINTS;
    for (int i = 0; i < attribute_count; i++)
      primitive.attributes[attributes[i].name] =
          put_floats(gltf, attributes[i].values, static_cast<size_t>(count), attributes[i].components,
                     std::strcmp(attributes[i].name, "POSITION") == 0);
    primitive.extensions[extension] = parse(extension_json);
    use_extension(gltf, extension);
    return put_mesh(gltf, name, primitive);
  });
}

int pags_gltf_node(pags_gltf *gltf, int parent, const char *name) {
  return guarded(gltf, [&] {
    tinygltf::Node node;
    node.name = unique(gltf->nodes, name);
    const int index = append(gltf->model.nodes, node);
    if (parent >= 0)
      node_at(gltf, parent).children.push_back(index);
    else if (parent == -1)
      gltf->model.scenes[0].nodes.push_back(index);
    return index;
  });
}

int pags_gltf_camera(pags_gltf *gltf, const char *name, const pags_camera *camera) {
  return guarded(gltf, [&] {
    tinygltf::Camera out;
    out.name = unique(gltf->cameras, name);
    out.type = "perspective";
    out.perspective.yfov = 2 * pags_atan(0.5 * camera->height / camera->fy);
    out.perspective.aspectRatio = camera->width / camera->fx / (camera->height / camera->fy);
    out.perspective.znear = 0.01;
    out.perspective.zfar = 1e5; /* finite: for an infinite far plane tinygltf would write zfar 0, which is invalid */
    return append(gltf->model.cameras, out);
  });
}

void pags_gltf_node_pose(pags_gltf *gltf, int node, const double pose[12]) {
  attempt(gltf, [&] {
    node_at(gltf, node).rotation = quaternion(pose);
    node_at(gltf, node).translation = {pose[3], pose[7], pose[11]};
  });
}

void pags_gltf_node_up(pags_gltf *gltf, int node, pags_up up) {
  static const double from_z[12] = {1, 0, 0, 0, 0, 0, 1, 0, 0, -1, 0, 0},
                      from_minus_y[12] = {1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, 0},
                      from_y[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  pags_gltf_node_pose(gltf, node, up == PAGS_UP_Z ? from_z : up == PAGS_UP_Y ? from_y : from_minus_y);
}

void pags_gltf_node_mesh(pags_gltf *gltf, int node, int mesh) {
  guarded(gltf, [&] { return node_at(gltf, node).mesh = mesh; });
}

void pags_gltf_node_camera(pags_gltf *gltf, int node, int camera) {
  guarded(gltf, [&] { return node_at(gltf, node).camera = camera; });
}

void pags_gltf_extras(pags_gltf *gltf, int node, const char *json) {
  attempt(gltf, [&] { (node < 0 ? gltf->model.asset.extras : node_at(gltf, node).extras) = parse(json); });
}

pags_result pags_gltf_put_extras(pags_gltf *gltf, int node, pags_json_writer *w) {
  pags_json_end_object(w);
  PAGS_TRY(pags_json_writer_finish(w));
  pags_gltf_extras(gltf, node, w->data);
  return PAGS_OK;
}

void pags_gltf_extension(pags_gltf *gltf, int node, const char *name, const char *json) {
  attempt(gltf, [&] {
    (node < 0 ? gltf->model.extensions : node_at(gltf, node).extensions)[name] = parse(json);
    use_extension(gltf, name);
  });
}

void pags_gltf_node_track(pags_gltf *gltf, int node, int64_t count, const double *times, const double (*poses)[12]) {
  attempt(gltf, [&] {
    std::vector<float> seconds, places, turns;
    double before[4] = {0, 0, 0, 0};
    for (int64_t i = 0; i < count; i++) {
      float t = static_cast<float>(times[i]);
      if (!seconds.empty() && !(t > seconds.back()))
        continue;
      std::vector<double> q = quaternion(poses[i]);
      /* q and -q are the same rotation: take the one nearer to the key before, so that interpolation turns the
       * shorter way round. */
      double along = q[0] * before[0] + q[1] * before[1] + q[2] * before[2] + q[3] * before[3];
      seconds.push_back(t);
      for (size_t k = 0; k < 4; k++) {
        before[k] = along < 0 ? -q[k] : q[k];
        turns.push_back(static_cast<float>(before[k]));
      }
      for (int k = 0; k < 3; k++)
        places.push_back(static_cast<float>(poses[i][4 * k + 3]));
    }
    if (gltf->model.animations.empty()) {
      gltf->model.animations.emplace_back();
      gltf->model.animations[0].name = "tracks";
    }
    int input = put_floats(gltf, seconds.data(), seconds.size(), 1, true, 0);
    add_channel(gltf, node, input, put_floats(gltf, places.data(), seconds.size(), 3, false, 0), "translation");
    add_channel(gltf, node, input, put_floats(gltf, turns.data(), seconds.size(), 4, false, 0), "rotation");
  });
}

pags_result pags_gltf_save(pags_gltf *gltf, const char *path) {
  if (gltf->failed)
    return pags_out_of_memory("%s", path);
  try {
    std::string glb = serialize(gltf);
    return strcasecmp(pags_path_extension(path), ".gltf") == 0 ? save_apart(glb, path)
                                                               : pags_file_write(path, glb.data(), glb.size());
  } catch (...) {
    return pags_out_of_memory("%s", path);
  }
}

} /* extern "C" */
