/* SPDX-License-Identifier: Apache-2.0 */
/* Early-Z in the modes PAGS_EARLY_Z_LOSSLESS and PAGS_EARLY_Z_BOUNDED: a frame is drawn in slabs of depth, front to
 * back, and clusters and Gaussians that only reach saturated pixels are left out before they are read or shaded. The
 * the slabs already drawn replace a depth pre-pass.
 *
 * Clusters are taken in ascending order of a lower bound of their members' depth keys, some thousand Gaussians per
 * slab. Let K be the bound of the next cluster. Every Gaussian whose key is below K has been read then, and those of
 * them that have not been drawn yet are a contiguous range of the frame's order (key, id): they are sorted, binned
 * and blended onto the state that earlier slabs left. Gaussians with keys from K on wait for a later slab. After each
 * slab, the blocks and tiles whose pixels have all stopped are marked as saturated.
 *
 * Why the picture has the same bits as with PAGS_EARLY_Z_OFF:
 *   (a) slab after slab, each pixel runs the same kernel over the same list, with its state unchanged in between;
 *   (b) whether a pixel stops depends on its own state only, not on its neighbours or on places in a list;
 *   (c) transmittance never grows, since rounding is monotone: a pixel that has stopped stays stopped, whatever is
 *       left out behind;
 *   (d) a Gaussian that is left out lies behind what has been drawn, since K is a lower bound of the keys as floats,
 *       and its reach, which holds every pixel that the rasteriser could change (cull.c, project.c), has only
 *       saturated blocks;
 *   (e) pixels beyond the picture's edge count as saturated.
 * A rolling shutter changes none of this: a Gaussian has one key, its depth when its line is read, for all pixels that
 * it covers, and both the clusters' bounds and the reaches hold for all times at which it may be drawn (cull.c). The
 * same holds for PAGS_EARLY_Z_BOUNDED, compared with a frame without slabs whose pixels also stop at T <= eps: the
 * number of slabs and the depths at which they are cut change no bit in either mode.
 *
 * Error of PAGS_EARLY_Z_BOUNDED: let a pixel stop at transmittance T <= eps where OFF continues. Until then both have
 * summed up the same C. OFF then adds sum(w_k c_k) + T' s, with weights w_k >= 0 that sum to T - T', colours c_k, and s
 * the colour of sky or background: something from 0 to T times the largest of these. BOUNDED adds T times the mean
 * colour in front, C / (1 - T), from 0 to T times the largest of the colours in front. So no channel is off by more
 * than T <= eps times the largest of shaded colours, sky and background. Rounding adds, in OFF, at most 2^-24 of the
 * sum per splat. Transmittance: OFF has T' <= T <= eps, BOUNDED 0. */
#include <string.h>

#include "frame/stages.h"

enum { GROUP = 16, MOST_GROUPS = 256 / GROUP }; /* members shaded as one vector; groups in the largest cluster */

/* A cluster that belongs to a slab of depth that is being drawn or has been drawn, and that may have Gaussians left for
 * later slabs. */
typedef struct active_cluster {
  int64_t view;                  /* index in the frame's clusters */
  bool fresh;                    /* not projected yet */
  uint16_t shaded;               /* bit g: the colours and tiles of group g have been computed */
  uint16_t waiting[MOST_GROUPS]; /* per group, a bit per member: neither drawn nor found hidden yet */
  uint16_t ready[MOST_GROUPS];   /* per group, a bit per member: to be drawn in this slab */
  int32_t ready_count, waiting_count, hidden_count, shaded_count;
  int64_t place; /* where the cluster's ready members begin in the frame's `drawn` */
} active_cluster;

typedef struct slabs {
  pags_frame *frame;
  depth_key *order;   /* clusters in view, by ascending lower bound of their members' keys */
  int64_t next;       /* index in `order` of the next cluster to take */
  uint64_t *taken;    /* a bit per cluster in view: taken into this slab */
  int64_t dense_next; /* dense index at which the next active cluster's members begin */
  active_cluster *active;
  int64_t active_count;
  pags_reach *reaches; /* per dense index: the 4x4-pixel blocks that the Gaussian may change */
  uint32_t limit;      /* K: Gaussians with keys below are drawn in this slab */
} slabs;

/* ---- Ordering and taking clusters ---- */

/* Whether the reach holds a block that isn't saturated. */
static bool is_open(const saturation *f, pags_reach r) {
  if (r.x0 >= r.x1)
    return false;
  const int first = r.x0 >> 6, last = (r.x1 - 1) >> 6;
  const uint64_t left = UINT64_MAX << (r.x0 & 63), right = UINT64_MAX >> (63 - ((r.x1 - 1) & 63));
  for (int y = r.y0; y < r.y1; y++) {
    const uint64_t *const row = f->open + (int64_t)y * f->words;
    for (int w = first; w <= last; w++)
      if (row[w] & (w == first ? left : UINT64_MAX) & (w == last ? right : UINT64_MAX))
        return true;
  }
  return false;
}

/* Allocates what all slabs share, marks all blocks as unsaturated, and sorts the clusters in view by the lower bound of
 * their members' depth. */
static pags_result begin(slabs *s) {
  pags_frame *const f = s->frame;
  const int64_t clusters = f->cluster_count, words = clusters / 64 + 1;
  depth_key *spare;
  PAGS_TRY(pags_frame_saturation_begin(f));
  PAGS_TRY(pags_frame_alloc(f, &s->order, clusters, sizeof *s->order, "cluster order"));
  PAGS_TRY(pags_frame_alloc(f, &spare, clusters, sizeof *spare, "cluster order"));
  for (int64_t i = 0; i < clusters; i++) {
    s->order[i] = (depth_key){.splat = (uint32_t)i};
    memcpy(&s->order[i].key, &f->bounds[i].near, sizeof s->order[i].key);
  }
  s->order = pags_frame_sort_keys(s->order, spare, clusters);
  PAGS_TRY(pags_frame_alloc(f, &s->taken, words, sizeof *s->taken, "cluster flags"));
  memset(s->taken, 0, (size_t)words * sizeof *s->taken);
  PAGS_TRY(pags_frame_alloc(f, &s->active, clusters, sizeof *s->active, "clusters at work"));
  PAGS_TRY(pags_frame_alloc(f, &s->reaches, f->dense_count, sizeof *s->reaches, "reaches"));
  return pags_frame_reserve_splats(f);
}

/* Takes clusters into the slab until they have `most` Gaussians in all, leaving out clusters that only reach
 * saturated blocks, and sets the slab's limit K. */
static void take_clusters(slabs *s, int64_t most) {
  pags_frame *const f = s->frame;
  int64_t taken = 0;
  for (; s->next < f->cluster_count && taken < most; s->next++) {
    const int64_t i = s->order[s->next].splat;
    if (!is_open(f->full, f->bounds[i].reach)) {
      f->stats.clusters_hidden++;
      continue;
    }
    s->taken[i / 64] |= UINT64_C(1) << i % 64;
    taken += f->clusters[i].count;
  }
  /* They become active in memory order, since that is the best order to read them in. Their members follow each other
   * in the dense arrays in the same order. */
  for (int64_t word = 0; word * 64 < f->cluster_count; word++) {
    for (uint64_t bits = s->taken[word]; bits; bits &= bits - 1) {
      const int64_t i = word * 64 + __builtin_ctzll(bits);
      f->clusters[i].base = s->dense_next;
      s->dense_next += (f->clusters[i].count + GROUP - 1) / GROUP * GROUP;
      s->active[s->active_count++] = (active_cluster){.view = i, .fresh = true};
    }
    s->taken[word] = 0;
  }
  f->stats.loaded += taken;
  f->last_slab = s->next == f->cluster_count;
  s->limit = f->last_slab ? UINT32_MAX : s->order[s->next].key;
}

/* ---- Choosing and shading a slab's Gaussians ---- */

/* Sorts the waiting members of a cluster: ready to be drawn in this slab (key below K), still waiting (key from K
 * on), or hidden (only reaches saturated blocks). Hidden members lose their key and are never looked at again. */
static void choose_members(const slabs *s, active_cluster *a) {
  const pags_frame *const f = s->frame;
  const view_cluster *const c = f->clusters + a->view;
  uint32_t *const keys = f->keys + c->base;
  a->ready_count = a->waiting_count = a->hidden_count = 0;
  for (int first = 0; first < c->count; first += GROUP) {
    unsigned ready = 0, later = 0;
    for (unsigned waiting = a->waiting[first / GROUP]; waiting; waiting &= waiting - 1) {
      const int k = first + __builtin_ctz(waiting);
      if (keys[k] >= s->limit) {
        later |= 1u << (k - first);
        a->waiting_count++;
      } else if (is_open(f->full, s->reaches[c->base + k])) {
        ready |= 1u << (k - first);
        a->ready_count++;
      } else {
        keys[k] = UINT32_MAX;
        a->hidden_count++;
      }
    }
    a->ready[first / GROUP] = (uint16_t)ready;
    a->waiting[first / GROUP] = (uint16_t)later;
  }
}

/* Block function: projects the fresh ones of the active clusters, and chooses the members to draw in this slab. */
static void project_active(void *context, int64_t begin, int64_t end, int worker) {
  const slabs *const s = context;
  const pags_frame *const f = s->frame;
  for (int64_t i = begin; i < end; i++) {
    active_cluster *const a = s->active + i;
    const view_cluster *const c = f->clusters + a->view;
    if (a->fresh && f->touch)
      f->touch(f->touch_user, c->part, c->cluster, worker);
    if (a->fresh) { /* the members that pass the projection wait to be drawn */
      pags_frame_project_cluster(f, c, false, s->reaches + c->base);
      for (int k = 0; k < c->count; k++)
        if (f->keys[c->base + k] != UINT32_MAX)
          a->waiting[k / GROUP] = (uint16_t)(a->waiting[k / GROUP] | 1u << k % GROUP);
      a->fresh = false;
    }
    choose_members(s, a);
  }
}

/* Computes colours and tiles of the groups of 16 members that have a member to be drawn, once per group. The group's
 * other members are lanes of the same vector, so that they cost nothing. */
static void shade_groups(const slabs *s, active_cluster *a) {
  const pags_frame *const f = s->frame;
  const view_cluster *const c = f->clusters + a->view;
  const pags_part *const part = f->parts + c->part;
  const pags_projection view = pags_frame_shading(f, c);
  const float *rows = NULL;
  row_scratch scratch;
  int64_t stride = 0;
  for (int first = 0; first < c->count; first += GROUP) {
    const int group = first / GROUP, count = c->count - first < GROUP ? c->count - first : GROUP;
    if (!a->ready[group] || (a->shaded >> group & 1))
      continue;
    if (!rows)
      rows = pags_frame_colours(part, c, view.sh_degree, &scratch, &stride);
    const uint32_t *const keys = f->keys + c->base + first;
    f->kernels->shade(&view, rows + first, stride, part->sh ? part->sh + c->first + first : NULL, count, keys,
                      f->splats + c->base + first);
    pags_frame_box_members(f, c->base + first, count);
    a->shaded = (uint16_t)(a->shaded | 1u << group);
    for (int k = 0; k < count; k++)
      a->shaded_count += keys[k] != UINT32_MAX;
  }
}

/* Block function: shades the active clusters that have members to draw, and lists these members in `drawn`. */
static void shade_active(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const slabs *const s = context;
  for (int64_t i = begin; i < end; i++) {
    active_cluster *const a = s->active + i;
    const view_cluster *const c = s->frame->clusters + a->view;
    if (!a->ready_count)
      continue;
    shade_groups(s, a);
    uint32_t *out = s->frame->drawn + a->place;
    for (int first = 0; first < c->count; first += GROUP)
      for (unsigned ready = a->ready[first / GROUP]; ready; ready &= ready - 1)
        *out++ = (uint32_t)(c->base + first + __builtin_ctz(ready));
  }
}

/* Projects, selects and shades the slab's Gaussians and lists them in `drawn`; then drops clusters that have no
 * waiting members. */
static pags_result select_and_shade(slabs *s) {
  pags_frame *const f = s->frame;
  double since = pags_clock_ms();
  PAGS_TRY(pags_frame_for(f, s->active_count, 8, project_active, s));
  f->drawn_count = 0;
  for (int64_t i = 0; i < s->active_count; i++) {
    s->active[i].place = f->drawn_count;
    f->drawn_count += s->active[i].ready_count;
    f->stats.hidden += s->active[i].hidden_count;
  }
  PAGS_TRY(pags_frame_alloc(f, &f->drawn, f->drawn_count, sizeof *f->drawn, "list of drawn parts"));
  f->stats.ms_project += pags_clock_lap_ms(&since);
  PAGS_TRY(pags_frame_for(f, s->active_count, 8, shade_active, s));

  /* Keeps the clusters that have waiting members active. */
  int64_t kept = 0;
  for (int64_t i = 0; i < s->active_count; i++) {
    s->frame->stats.shaded += s->active[i].shaded_count;
    s->active[i].shaded_count = 0;
    if (s->active[i].waiting_count)
      s->active[kept++] = s->active[i];
  }
  s->active_count = kept;
  f->stats.ms_shade += pags_clock_lap_ms(&since);
  return PAGS_OK;
}

/* ---- Drawing the slabs ---- */

/* The fraction of the Gaussians that would have been shaded without Early-Z that were hidden. In clusters that were
 * never read, as many are assumed to pass the projection as in those that were. */
static double hidden_share(const pags_frame_stats *stats) {
  const double passed = (double)(stats->hidden + stats->shaded);
  if (stats->loaded == 0 || passed <= 0.0)
    return 0.0;
  const double unread = (double)(stats->in_view - stats->loaded) * passed / (double)stats->loaded;
  return ((double)stats->hidden + unread) / (passed + unread);
}

pags_result pags_frame_early_z_slabs(pags_frame *frame) {
  enum { SLABS = 4, LEAST = 4096 };
  slabs s = {.frame = frame};
  pags_frame_stats *const stats = &frame->stats;
  double since = pags_clock_ms();
  PAGS_TRY(begin(&s));
  stats->ms_occlude = pags_clock_lap_ms(&since);

  /* Gaussians per slab: options.slab_size if set, else a quarter of the Gaussians that are likely to be read, by the
   * last frame's hidden fraction, but at least 4096. With four slabs, most of what is hidden lies behind a slab that
   * has been drawn. */
  const double read = (1.0 - frame->hiding) * (double)stats->in_view;
  const int64_t most = frame->options.slab_size > 0   ? frame->options.slab_size
                       : read > SLABS * (double)LEAST ? (int64_t)(read / SLABS)
                                                      : LEAST;
  do {
    const pags_arena_mark mark = pags_arena_save(frame->arena);
    take_clusters(&s, most);
    stats->ms_occlude += pags_clock_lap_ms(&since);
    PAGS_TRY(select_and_shade(&s));
    since = pags_clock_ms();
    PAGS_TRY(pags_stage_bin(frame));
    stats->ms_bin += pags_clock_lap_ms(&since);
    PAGS_TRY(pags_stage_sort(frame));
    stats->ms_sort += pags_clock_lap_ms(&since);
    PAGS_TRY(pags_stage_raster(frame));
    stats->ms_raster += pags_clock_lap_ms(&since);
    if (!frame->last_slab)
      pags_frame_saturation_update(frame);
    stats->ms_occlude += pags_clock_lap_ms(&since);
    stats->slabs++;
    pags_arena_release(frame->arena, mark);
  } while (!frame->last_slab && frame->full->tiles_full < stats->tiles);
  stats->tiles_full = frame->full->tiles_full;
  /* The clusters that no slab has taken are hidden too: all tiles were saturated before. */
  stats->clusters_hidden += frame->cluster_count - s.next;
  for (int64_t i = 0; i < s.active_count; i++)
    stats->hidden += s.active[i].waiting_count;
  frame->hiding = hidden_share(stats);
  return PAGS_OK;
}
