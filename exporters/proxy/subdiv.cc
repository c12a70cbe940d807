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

std::unique_ptr<far::TopologyRefiner> make_refiner(const pags_quads *mesh) {
  std::vector<int> sizes(static_cast<size_t>(mesh->quad_count), 4);
  far::TopologyDescriptor descriptor;
  descriptor.numVertices = mesh->vertex_count;
  descriptor.numFaces = mesh->quad_count;
  descriptor.numVertsPerFace = sizes.data();
  descriptor.vertIndicesPerFace = mesh->quads;
  using factory = far::TopologyRefinerFactory<far::TopologyDescriptor>;
  std::unique_ptr<far::TopologyRefiner> refiner(
      factory::Create(descriptor, factory::Options(sdc::SCHEME_CATMARK, sdc::Options())));
  if (!refiner)
    throw std::bad_alloc();
  return refiner;
}

template <typename T>
T *copy(const std::vector<T> &from) {
  T *out = static_cast<T *>(std::malloc((from.size() + 1) * sizeof(T)));
  if (!out)
    throw std::bad_alloc();
  if (!from.empty())
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
  *stencils = {};
}

void pags_quads_destroy(pags_quads *quads) {
  std::free(quads->positions);
  std::free(quads->quads);
  *quads = {};
}

pags_result pags_subdiv_stencils(const pags_quads *mesh, int side, pags_stencils *out) {
  *out = {};
  try {
    std::unique_ptr<far::TopologyRefiner> refiner = make_refiner(mesh);
    refiner->RefineAdaptive(far::TopologyRefiner::AdaptiveOptions(4));
    std::vector<float> s, t;
    for (int j = 0; j < side; j++)
      for (int i = 0; i < side; i++) {
        s.push_back((static_cast<float>(i) + 0.5f) / static_cast<float>(side));
        t.push_back((static_cast<float>(j) + 0.5f) / static_cast<float>(side));
      }
    far::LimitStencilTableFactory::LocationArrayVec places(static_cast<size_t>(mesh->quad_count));
    for (int q = 0; q < mesh->quad_count; q++) {
      far::LimitStencilTableFactory::LocationArray &place = places[static_cast<size_t>(q)];
      place.ptexIdx = q; /* all faces are quads, so each is one ptex face */
      place.numLocations = side * side;
      place.s = s.data();
      place.t = t.data();
    }
    std::unique_ptr<const far::LimitStencilTable> table(far::LimitStencilTableFactory::Create(*refiner, places));
    if (!table)
      throw std::bad_alloc();
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
    return PAGS_OK;
  } catch (...) {
    return failed();
  }
}

pags_result pags_subdiv_refine(const pags_quads *mesh, int level, pags_quads *out) {
  *out = {};
  try {
    std::unique_ptr<far::TopologyRefiner> refiner = make_refiner(mesh);
    far::TopologyRefiner::UniformOptions uniform(level);
    uniform.fullTopologyInLastLevel = true; /* PrimvarRefiner::Limit needs it */
    refiner->RefineUniform(uniform);
    far::PrimvarRefiner primvar(*refiner);
    std::vector<point> from(static_cast<size_t>(mesh->vertex_count));
    std::memcpy(from.data(), mesh->positions, from.size() * sizeof(point));
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
    out->vertex_count = static_cast<int>(limit.size());
    out->quad_count = last.GetNumFaces();
    out->positions = copy(values);
    out->quads = copy(faces);
    return PAGS_OK;
  } catch (...) {
    return failed();
  }
}

} /* extern "C" */
