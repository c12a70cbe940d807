/* SPDX-License-Identifier: Apache-2.0 */
/* Subdivision of quad meshes (Catmull and Clark 1978) and stencils of the limit surface, by OpenSubdiv. This is the
 * only file that includes OpenSubdiv; every C++ exception is caught here and becomes PAGS_ERROR_MEMORY. */
#define _DARWIN_C_SOURCE /* alloca on macOS, which OpenSubdiv's headers call */
#include "exporters/proxy/subdiv.h"

#include <cstdlib>
#include <cstring>
#include <memory>
#include <vector>

#include <opensubdiv/far/primvarRefiner.h>
#include <opensubdiv/far/stencilTableFactory.h>
#include <opensubdiv/far/topologyDescriptor.h>

#include "base/memory.h"

namespace far = OpenSubdiv::Far;
namespace sdc = OpenSubdiv::Sdc;

namespace {

/* A position, with the operations that OpenSubdiv's interpolation calls. */
struct point {
  float p[3];
  void Clear() {
    p[0] = p[1] = p[2] = 0;
  }
  void AddWithWeight(const point &other, float weight) {
    for (int k = 0; k < 3; k++)
      p[k] += weight * other.p[k];
  }
};

std::unique_ptr<far::TopologyRefiner> make_refiner(int vertex_count, int quad_count, const int *quads) {
  std::vector<int> sizes(static_cast<size_t>(quad_count), 4);
  far::TopologyDescriptor descriptor;
  descriptor.numVertices = vertex_count;
  descriptor.numFaces = quad_count;
  descriptor.numVertsPerFace = sizes.data();
  descriptor.vertIndicesPerFace = quads;
  using factory = far::TopologyRefinerFactory<far::TopologyDescriptor>;
  return std::unique_ptr<far::TopologyRefiner>(
      factory::Create(descriptor, factory::Options(sdc::SCHEME_CATMARK, sdc::Options())));
}

template <typename T>
T *copy(const std::vector<T> &from) {
  T *out = static_cast<T *>(std::malloc((from.size() + 1) * sizeof(T)));
  if (out && !from.empty())
    std::memcpy(out, from.data(), from.size() * sizeof(T));
  return out;
}

pags_result failed() {
  return pags_out_of_memory("a subdivision surface");
}

} /* namespace */

extern "C" {

void pags_stencils_destroy(pags_stencils *stencils) {
  std::free(stencils->first);
  std::free(stencils->indices);
  std::free(stencils->weights);
  std::memset(stencils, 0, sizeof *stencils);
}

pags_result pags_subdiv_stencils(int vertex_count, int quad_count, const int *quads, int side, pags_stencils *out) {
  std::memset(out, 0, sizeof *out);
  try {
    std::unique_ptr<far::TopologyRefiner> refiner = make_refiner(vertex_count, quad_count, quads);
    if (!refiner)
      return failed();
    refiner->RefineAdaptive(far::TopologyRefiner::AdaptiveOptions(4));
    std::vector<float> s, t;
    for (int j = 0; j < side; j++)
      for (int i = 0; i < side; i++) {
        s.push_back((static_cast<float>(i) + 0.5f) / static_cast<float>(side));
        t.push_back((static_cast<float>(j) + 0.5f) / static_cast<float>(side));
      }
    far::LimitStencilTableFactory::LocationArrayVec places(static_cast<size_t>(quad_count));
    for (int q = 0; q < quad_count; q++) {
      far::LimitStencilTableFactory::LocationArray &place = places[static_cast<size_t>(q)];
      place.ptexIdx = q; /* all faces are quads, so each is one ptex face */
      place.numLocations = side * side;
      place.s = s.data();
      place.t = t.data();
    }
    std::unique_ptr<const far::LimitStencilTable> table(far::LimitStencilTableFactory::Create(*refiner, places));
    if (!table)
      return failed();
    std::vector<int64_t> first;
    std::vector<int32_t> indices;
    std::vector<float> weights;
    for (int i = 0; i < table->GetNumStencils(); i++) {
      far::LimitStencil stencil = table->GetLimitStencil(i);
      first.push_back(static_cast<int64_t>(indices.size()));
      for (int k = 0; k < stencil.GetSize(); k++) {
        indices.push_back(stencil.GetVertexIndices()[k]);
        weights.push_back(stencil.GetWeights()[k]);
      }
    }
    first.push_back(static_cast<int64_t>(indices.size()));
    out->count = table->GetNumStencils();
    out->first = copy(first);
    out->indices = copy(indices);
    out->weights = copy(weights);
    if (out->first && out->indices && out->weights)
      return PAGS_OK;
  } catch (...) {
  }
  pags_stencils_destroy(out);
  return failed();
}

pags_result pags_subdiv_refine(int vertex_count, const float *positions, int quad_count, const int *quads, int level,
                               int *out_vertex_count, float **out_positions, int *out_quad_count, int **out_quads) {
  *out_positions = nullptr;
  *out_quads = nullptr;
  try {
    std::unique_ptr<far::TopologyRefiner> refiner = make_refiner(vertex_count, quad_count, quads);
    if (!refiner)
      return failed();
    far::TopologyRefiner::UniformOptions uniform(level);
    uniform.fullTopologyInLastLevel = true; /* PrimvarRefiner::Limit needs it */
    refiner->RefineUniform(uniform);
    far::PrimvarRefiner primvar(*refiner);
    std::vector<point> from(static_cast<size_t>(vertex_count));
    std::memcpy(from.data(), positions, from.size() * sizeof(point));
    for (int l = 1; l <= level; l++) {
      std::vector<point> to(static_cast<size_t>(refiner->GetLevel(l).GetNumVertices()));
      primvar.Interpolate(l, from, to);
      from.swap(to);
    }
    std::vector<point> limit(from.size());
    primvar.Limit(from, limit);
    const far::TopologyLevel &last = refiner->GetLevel(level);
    std::vector<int> faces;
    for (int f = 0; f < last.GetNumFaces(); f++) {
      far::ConstIndexArray corners = last.GetFaceVertices(f);
      faces.insert(faces.end(), corners.begin(), corners.end());
    }
    std::vector<float> values(3 * limit.size());
    std::memcpy(values.data(), limit.data(), values.size() * sizeof(float));
    *out_vertex_count = static_cast<int>(limit.size());
    *out_quad_count = last.GetNumFaces();
    *out_positions = copy(values);
    *out_quads = copy(faces);
    if (*out_positions && *out_quads)
      return PAGS_OK;
  } catch (...) {
  }
  std::free(*out_positions);
  std::free(*out_quads);
  *out_positions = nullptr;
  *out_quads = nullptr;
  return failed();
}

} /* extern "C" */
