/* SPDX-License-Identifier: Apache-2.0 */
/* Fuzz targets of the input that pages of pags view send: messages, and the headers by which a page is admitted. */
#include "fuzz/fuzz.h"

#include <math.h>
#include <string.h>

#include "cli/view/access.h"
#include "cli/view/request.h"

/* ---- Messages ---- */

static int run_request(const uint8_t *data, size_t size) {
  static pags_view_request request;
  const pags_result result = pags_view_request_parse((const char *)data, size, &request);
  if (result != PAGS_OK) {
    fuzz_refused(result, "message");
    return 0;
  }
  FUZZ_CHECK(size <= PAGS_VIEW_MESSAGE && request.serial >= 0);
  if (request.kind == PAGS_VIEW_PICK)
    FUZZ_CHECK(isfinite(request.x) && isfinite(request.y));
  if (request.kind != PAGS_VIEW_LOOK)
    return 1;
  pags_view_look *const look = &request.look;
  FUZZ_CHECK(look->camera.width >= 1 && look->camera.width <= PAGS_VIEW_SIDE);
  FUZZ_CHECK(look->camera.height >= 1 && look->camera.height <= PAGS_VIEW_SIDE);
  FUZZ_CHECK(pags_camera_check(&look->camera, "again") == PAGS_OK && !isinf(look->camera.time));
  FUZZ_CHECK(look->channel >= 0 && look->channel < PAGS_VIEW_CHANNELS && look->view >= -1 && look->solo >= -1);
  FUZZ_CHECK(look->hidden_count >= 0 && look->hidden_count <= PAGS_VIEW_HIDDEN);
  for (int i = 0; i < look->hidden_count; i++)
    FUZZ_CHECK(look->hidden[i] >= 0);
  return 1;
}

static void seed_request(void) {
  fuzz_seed_text(
      "{\"type\": \"look\", \"serial\": 12, \"camera\": {\"width\": 64, \"height\": 48, \"fx\": 50, \"fy\": 50.5, "
      "\"cx\": 32, \"cy\": 24, \"pose\": [1, 0, 0, 4.5, 0, 0, 1, -2, 0, -1, 0, 3], \"time\": 1.25}, "
      "\"channel\": \"depth\", \"view\": 3, \"solo\": -1, \"hidden\": [0, 4, 17], \"full\": true}");
  fuzz_seed_text("{\"type\": \"pick\", \"serial\": 3, \"x\": 20.5, \"y\": 7}");
  fuzz_seed_text("{\"type\": \"got\", \"serial\": 12}");
}

static const char *const request_words[] = {
    "\"hidden\": [", "\"pose\": [", "\"channel\": ", "\"photograph\"", "\"view\": ", "\"solo\": ", "1e308", "-1",
    "2147483648",    "2049",        "null",          "\"pick\"",       NULL};
static const fuzz_target request = {
    .name = "view_request", .seeds = seed_request, .run = run_request, .words = request_words, .times = 256};

/* ---- Headers ---- */

/* The input is a Host, an Origin, a token and a Cookie. It is accepted if the token or the cookie equals the gate's
 * token in every byte. */
static int run_gate(const uint8_t *data, size_t size) {
  enum { PARTS = 4 };
  static const unsigned char bytes[PAGS_ACCESS_TOKEN_BYTES] = {1, 35, 69, 103, 137, 171, 205, 239};
  pags_access gate;
  fuzz_part parts[PARTS];
  FUZZ_CHECK(pags_access_create(&gate, bytes, "127.0.0.1", 8765, "view.example,[::1]:9") == PAGS_OK);
  fuzz_parts(data, size, PARTS, parts);
  const char *text[PARTS];
  for (int i = 0; i < PARTS; i++)
    text[i] = parts[i].bytes ? (const char *)parts[i].bytes : "";
  const bool host = pags_access_allows_host(&gate, text[0]), origin = pags_access_allows_origin(&gate, text[1]);
  const bool token = pags_access_is_token(&gate, text[2], strlen(text[2])),
             cookie = pags_access_allows_cookie(&gate, text[3]);
  FUZZ_CHECK(!host || strlen(text[0]) < PAGS_ACCESS_NAME);
  FUZZ_CHECK(!origin || strstr(text[1], "://"));
  FUZZ_CHECK(token == !strcmp(text[2], gate.token));
  FUZZ_CHECK(!cookie || (strstr(text[3], gate.token) && strstr(text[3], gate.cookie)));
  fuzz_parts_free(PARTS, parts);
  return host && origin && (token || cookie);
}

#define FUZZ_TOKEN "0123456789abcdef00000000000000000000000000000000"

static void seed_gate(void) {
  fuzz_seed_text("127.0.0.1:8765" FUZZ_CUT "http://localhost:8765" FUZZ_CUT FUZZ_TOKEN FUZZ_CUT "a=b");
  fuzz_seed_text("view.example" FUZZ_CUT "https://View.Example" FUZZ_CUT "1" FUZZ_CUT "x=y; pags_8765=" FUZZ_TOKEN);
}

static const char *const gate_words[] = {FUZZ_TOKEN,       "pags_8765=",   "http://", "https://",
                                         "127.0.0.1:8765", "view.example", ";",       NULL};
static const fuzz_target gate = {.name = "view_gate", .seeds = seed_gate, .run = run_gate, .words = gate_words};

const fuzz_target *const fuzz_targets[] = {&request, &gate, NULL};
