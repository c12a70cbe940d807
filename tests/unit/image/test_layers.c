/* SPDX-License-Identifier: Apache-2.0 */
/* Tests which channels of an EXR file are taken as its picture, and the position of its windows. */
#include "image/layers.h"

#include "unit/scratch.h"

enum { MOST = 12 };

/* Names of channels. "|" begins the next part and is followed by its name; "#" precedes channels of integers. */
typedef struct layer_case {
  const char *names[MOST];
  const char *layer; /* the selected layer, or a part of the error message */
  int part, channels;
  int order[4];
  pags_layer_rule rule;
  bool refused;
} layer_case;

static void check(const layer_case *c) {
  pags_layer_channel channels[MOST];
  pags_layer layer;
  const char *part = "";
  int count = 0, index = 0, parts = 0;
  for (int i = 0; i < MOST && c->names[i]; i++) {
    if (c->names[i][0] == '|') {
      part = c->names[i] + 1;
      parts++;
      index = 0;
      continue;
    }
    const bool number = c->names[i][0] == '#';
    channels[count++] = (pags_layer_channel){c->names[i] + number, part, parts > 0 ? parts - 1 : 0, index++, number};
  }
  const pags_result result = pags_layer_choose("a.exr", channels, count, &layer);
  if (c->refused) {
    scratch_expect(result, PAGS_ERROR_FORMAT, c->layer);
    return;
  }
  scratch_ok(result);
  assert_string_equal(layer.name, c->layer);
  assert_int_equal(layer.part, c->part);
  assert_int_equal(layer.channels, c->channels);
  assert_int_equal(layer.rule, c->rule);
  assert_int_equal(layer.alpha, c->channels == 2 || c->channels == 4);
  for (int i = 0; i < c->channels; i++)
    assert_int_equal(layer.order[i], c->order[i]);
}

static void test_choice(void **state) {
  (void)state;
  static const layer_case cases[] = {
      {{"B", "G", "R"}, "", 0, 3, {2, 1, 0}, PAGS_LAYER_ONLY, false},
      {{"A", "B", "G", "R", "Z", "#id"}, "", 0, 4, {3, 2, 1, 0}, PAGS_LAYER_ONLY, false},
      {{"Y"}, "", 0, 1, {0}, PAGS_LAYER_ONLY, false},
      {{"distance"}, "", 0, 1, {0}, PAGS_LAYER_ONLY, false},
      {{"A", "Y", "Z"}, "", 0, 2, {1, 0}, PAGS_LAYER_ONLY, false},
      {{"AO.B", "AO.G", "AO.R", "B", "G", "R"}, "", 0, 3, {5, 4, 3}, PAGS_LAYER_NAMED, false},
      {{"V.AO.B", "V.AO.G", "V.AO.R", "V.Combined.A", "V.Combined.B", "V.Combined.G", "V.Combined.R", "V.Depth.Z",
        "V.Normal.X", "V.Normal.Y", "V.Normal.Z"},
       "V.Combined",
       0,
       4,
       {6, 5, 4, 3},
       PAGS_LAYER_NAMED,
       false},
      {{"a.b.v2.Combined.B", "a.b.v2.Combined.G", "a.b.v2.Combined.R", "a.b.v2.AO.R"},
       "a.b.v2.Combined",
       0,
       3,
       {2, 1, 0},
       PAGS_LAYER_NAMED,
       false},
      {{"One.Combined.B", "One.Combined.G", "One.Combined.R", "Two.Combined.B", "Two.Combined.G", "Two.Combined.R"},
       "One.Combined",
       0,
       3,
       {2, 1, 0},
       PAGS_LAYER_FIRST,
       false},
      {{"AA.Combined.B", "AA.Combined.G", "AA.Combined.R", "ViewLayer.Combined.B", "ViewLayer.Combined.G",
        "ViewLayer.Combined.R"},
       "ViewLayer.Combined",
       0,
       3,
       {5, 4, 3},
       PAGS_LAYER_FIRST,
       false},
      {{"Composite.Combined.B", "Composite.Combined.G", "Composite.Combined.R", "A.Combined.B", "A.Combined.G",
        "A.Combined.R"},
       "Composite.Combined",
       0,
       3,
       {2, 1, 0},
       PAGS_LAYER_NAMED,
       false},
      {{"Combined.left.B", "Combined.left.G", "Combined.left.R", "Combined.right.B", "Combined.right.G",
        "Combined.right.R"},
       "Combined.left",
       0,
       3,
       {2, 1, 0},
       PAGS_LAYER_FIRST,
       false},
      {{"albedo.B", "albedo.G", "albedo.R", "beauty.Blue", "beauty.Green", "beauty.Red"},
       "beauty",
       0,
       3,
       {5, 4, 3},
       PAGS_LAYER_NAMED,
       false},
      {{"diffuse.B", "diffuse.G", "diffuse.R", "Z"}, "diffuse", 0, 3, {2, 1, 0}, PAGS_LAYER_NAMED, false},
      {{"diffuse.B", "diffuse.G", "diffuse.R", "gloss.B", "gloss.G", "gloss.R"},
       "may be its picture: diffuse, gloss; expected",
       .refused = true},
      {{"X", "Y", "Z"}, "no colours among the channels of this EXR file: X, Y, Z", .refused = true},
      {{"V.Depth.Z", "V.Normal.X", "V.Normal.Y", "V.Normal.Z"}, "no colours", .refused = true},
      {{"G", "R"}, "no colours", .refused = true},
      {{"BY", "RY", "Y"}, "luminance and chroma", .refused = true},
      {{"#B", "#G", "#R"}, "the channel R of this EXR file holds integers", .refused = true},
      {{"#id"}, "the channel id of this EXR file holds integers", .refused = true},
      {{"|depth", "Z", "|rgba", "A", "B", "G", "R"}, "rgba", 1, 4, {3, 2, 1, 0}, PAGS_LAYER_NAMED, false},
      {{"|V.AO", "B", "G", "R", "|V.Combined", "B", "G", "R"}, "V.Combined", 1, 3, {2, 1, 0}, PAGS_LAYER_NAMED, false},
      {{"|left", "B", "G", "R", "|right", "B", "G", "R"}, "left", 0, 3, {2, 1, 0}, PAGS_LAYER_FIRST, false},
      {{"|x", "s.B", "s.G", "s.R", "|y", "t.B", "t.G", "t.R"}, "may be its picture: s, t", .refused = true},
  };
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
    check(&cases[i]);
}

static void test_windows(void **state) {
  (void)state;
  static const struct {
    pags_window_box data, shown;
    pags_image_window window;
    const char *refusal;
  } cases[] = {
      {{0, 0, 64, 48}, {0, 0, 64, 48}, PAGS_WINDOW_WHOLE, NULL},
      {{100, -50, 164, -2}, {100, -50, 164, -2}, PAGS_WINDOW_WHOLE, NULL},
      {{-8, -6, 72, 54}, {0, 0, 64, 48}, PAGS_WINDOW_LARGER, NULL},
      {{16, 12, 48, 36}, {0, 0, 64, 48}, PAGS_WINDOW_PARTIAL, NULL},
      {{-8, 0, 60, 48}, {0, 0, 64, 48}, PAGS_WINDOW_PARTIAL, NULL},
      {{64, 0, 128, 48}, {0, 0, 64, 48}, PAGS_WINDOW_WHOLE, "a.exr: the data window (64,0 to 127,47) has no part"},
      {{0, 0, 8, 8}, {0, 0, 60000, 60000}, PAGS_WINDOW_WHOLE, "next to none"},
      {{0, 0, 70000, 8}, {0, 0, 64, 48}, PAGS_WINDOW_WHOLE, "sides of 1..65535"},
      {{0, 0, 64, 48}, {0, 0, 0, 48}, PAGS_WINDOW_WHOLE, "sides of 1..65535"},
  };
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    pags_image_window window = PAGS_WINDOW_WHOLE;
    const pags_result result = pags_window_compare("a.exr", &cases[i].data, &cases[i].shown, &window);
    if (cases[i].refusal)
      scratch_expect(result, PAGS_ERROR_FORMAT, cases[i].refusal);
    else
      scratch_ok(result);
    assert_int_equal(window, cases[i].window);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_choice),
      cmocka_unit_test(test_windows),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
