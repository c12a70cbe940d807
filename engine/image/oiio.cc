/* SPDX-License-Identifier: Apache-2.0 */
// OpenImageIO behind the C table of oiio.h: the only file that sees it.
//
// OpenImageIO 2.4 up to 3.x. It is a module of its own, because linking it costs 0.2-0.3 s at every process start.

#include "image/oiio.h"

#include <OpenImageIO/imageio.h>

#include <cstdio>
#include <cstring>
#include <exception>
#include <memory>
#include <new>
#include <string>

namespace {

struct reader {
  std::unique_ptr<OIIO::ImageInput> input;
  std::string part; // name of the part
};

// OpenImageIO's messages may have several lines; ours have one.
void set_message(pags_oiio_message *message, const std::string &text) {
  std::string line;
  for (char c : text) {
    if (c != '\n' && c != '\r')
      line += c;
    else if (!line.empty() && line.back() != ' ')
      line += ' ';
  }
  while (!line.empty() && line.back() == ' ')
    line.pop_back();
  std::snprintf(message->text, sizeof message->text, "%s", line.empty() ? "unknown error" : line.c_str());
}

// Calls `body` and turns whatever it throws into a result.
template <class Body>
pags_result guarded(pags_oiio_message *message, Body body) {
  try {
    return body();
  } catch (const std::bad_alloc &) {
    set_message(message, "out of memory");
    return PAGS_ERROR_MEMORY;
  } catch (const std::exception &error) {
    set_message(message, error.what());
    return PAGS_ERROR_FORMAT;
  } catch (...) {
    set_message(message, "unknown exception");
    return PAGS_ERROR_FORMAT;
  }
}

OIIO::TypeDesc type_of(pags_sample sample) {
  return sample == PAGS_U8    ? OIIO::TypeDesc::UINT8
         : sample == PAGS_U16 ? OIIO::TypeDesc::UINT16
                              : OIIO::TypeDesc::FLOAT;
}

void describe(reader *r, pags_oiio_info *info) {
  const OIIO::ImageSpec &spec = r->input->spec();
  const std::string format = r->input->format_name();
  *info = {};
  info->width = spec.width;
  info->height = spec.height;
  info->depth = spec.depth;
  if (format == "openexr") {
    info->left = spec.x;
    info->top = spec.y;
    info->shown_left = spec.full_x;
    info->shown_top = spec.full_y;
    info->shown_width = spec.full_width;
    info->shown_height = spec.full_height;
  }
  info->channels = spec.nchannels;
  const auto base = spec.format.basetype;
  info->sample = base == OIIO::TypeDesc::UINT8 ? PAGS_U8 : base == OIIO::TypeDesc::UINT16 ? PAGS_U16 : PAGS_F32;
  info->alpha = spec.alpha_channel >= 0 && spec.alpha_channel == (spec.nchannels == 2 ? 1 : 3);
  // Of the integer formats with alpha, only TIFF and WebP (up to OpenImageIO 2.4) give colours that are multiplied by
  // it.
  info->straight = spec.get_int_attribute("oiio:UnassociatedAlpha", 0) != 0 ||
                   (info->sample != PAGS_F32 && format != "tiff" && format != "webp");
  const int orientation = spec.get_int_attribute("Orientation", 1);
  info->orientation = orientation >= 1 && orientation <= 8 ? orientation : 1;
  info->pixel_aspect = spec.get_float_attribute("PixelAspectRatio", 1);
  if (const OIIO::ParamValue *p = spec.find_attribute("ICCProfile"))
    if (p->type().basetype == OIIO::TypeDesc::UINT8) {
      info->profile = static_cast<const unsigned char *>(p->data());
      info->profile_size = p->type().size();
    }
  if (const OIIO::ParamValue *p = spec.find_attribute("chromaticities"))
    if (p->type().basetype == OIIO::TypeDesc::FLOAT && p->type().numelements() == 8 && p->type().aggregate == 1)
      std::memcpy(info->chromaticities, p->data(), sizeof info->chromaticities);
  if (const OIIO::ParamValue *p = spec.find_attribute("CICP"))
    if (p->type().basetype == OIIO::TypeDesc::INT && p->type().numelements() == 4)
      std::memcpy(info->cicp, p->data(), sizeof info->cicp);
  std::string space = spec.get_string_attribute("tiff:ColorSpace");
  if (space.empty() || space == "RGB")
    space = spec.get_string_attribute("oiio:ColorSpace");
  std::snprintf(info->space, sizeof info->space, "%s", space.c_str());
  r->part = spec.get_string_attribute("oiio:subimagename");
  info->part = r->part.c_str();
}

pags_result open_reader(const char *path, void **out, pags_oiio_info *info, pags_oiio_message *message) {
  return guarded(message, [&] {
    // Alpha is left as the file has it: premultiplying on read would darken the edges of masks kept as alpha.
    OIIO::ImageSpec config;
    config.attribute("oiio:UnassociatedAlpha", 1);
    auto input = OIIO::ImageInput::open(path, &config);
    if (!input) {
      set_message(message, OIIO::geterror());
      return PAGS_ERROR_FORMAT;
    }
    auto opened = std::make_unique<reader>();
    opened->input = std::move(input);
    describe(opened.get(), info);
    *out = opened.release();
    return PAGS_OK;
  });
}

int go_to_part(void *handle, int index, pags_oiio_info *info) {
  pags_oiio_message ignored;
  reader *const r = static_cast<reader *>(handle);
  return guarded(&ignored, [&] {
           if (!r->input->seek_subimage(index, 0)) {
             r->input->geterror(); // clears it
             return PAGS_ERROR_ARGUMENT;
           }
           describe(r, info);
           return PAGS_OK;
         }) == PAGS_OK;
}

const char *channel_of(void *handle, int index, int *number) {
  const OIIO::ImageSpec &spec = static_cast<reader *>(handle)->input->spec();
  *number = spec.channelformat(index).basetype == OIIO::TypeDesc::UINT32;
  return spec.channelnames[static_cast<size_t>(index)].c_str();
}

pags_result read_pixels(void *handle, const int *channels, int count, pags_sample sample, int step, void *data,
                        pags_oiio_message *message) {
  return guarded(message, [&] {
    OIIO::ImageInput *input = static_cast<reader *>(handle)->input.get();
    const OIIO::TypeDesc type = type_of(sample);
    const OIIO::stride_t stride = static_cast<OIIO::stride_t>(type.size()) * step;
    const int part = input->current_subimage();
    for (int i = 0; i < count;) { // neighbours in the file are read at once
      int end = i + 1;
      while (end < count && channels[end] == channels[end - 1] + 1)
        end++;
      char *const to = static_cast<char *>(data) + type.size() * static_cast<size_t>(i);
      // The reader of TIFF returns true for a file that is cut off, but leaves its message.
      if (!input->read_image(part, 0, channels[i], channels[end - 1] + 1, type, to, stride) || input->has_error()) {
        set_message(message, input->geterror());
        return PAGS_ERROR_FORMAT;
      }
      i = end;
    }
    return PAGS_OK;
  });
}

void close_reader(void *handle) {
  pags_oiio_message ignored;
  guarded(&ignored, [&] {
    delete static_cast<reader *>(handle);
    return PAGS_OK;
  });
}

} // namespace

extern "C" const void *pags_oiio_table(void) {
  static const pags_oiio table = {PAGS_OIIO_VERSION, open_reader, go_to_part, channel_of, read_pixels, close_reader};
  try {
    // Our own pool decodes several pictures at once; threads of OpenImageIO's and OpenEXR's would only add to them.
    OIIO::attribute("threads", 1);
    OIIO::attribute("exr_threads", -1);
  } catch (...) {
    return nullptr;
  }
  return &table;
}
