#include "scenarios/loader/images.h"

#include <algorithm>
#include <cassert>
#include <limits>
#include <span>
#include <string>
#include <utility>

#include "engine/numerics/error.h"
#include "scenarios/loader/image_files.h"

namespace sulcus {

namespace {

namespace fs = std::filesystem;

template <class T>
void copy_labels(const std::vector<char>& bytes, const fs::path& path, LabelMap& map) {
  using Limits = std::numeric_limits<std::int32_t>;
  const T* values = reinterpret_cast<const T*>(bytes.data());
  for (std::size_t voxel = 0; voxel < map.labels.size(); ++voxel) {
    const T value = values[voxel];
    if (std::cmp_less(value, Limits::min()) || std::cmp_greater(value, Limits::max())) {
      throw InputError(path.string() + ": voxel " + std::to_string(voxel) + " has the label " +
                       std::to_string(value) + "; labels must lie within " + std::to_string(Limits::min()) +
                       " .. " + std::to_string(Limits::max()));
    }
    map.labels[voxel] = static_cast<std::int32_t>(value);
  }
}

}  // namespace

std::vector<fs::path> label_map_files(const fs::path& path) {
  const fs::path data = find_image_data(path, image_format(path)).file;
  if (data == path) return {path};
  return {path, data};
}

LabelMap read_label_map(const fs::path& path) {
  LabelMap map;
  const VoxelImage image = read_image(path, ImageUse::labels);
  map.size = image.geometry.size;
  map.spacing = image.geometry.spacing;
  map.origin = image.geometry.origin;
  map.direction = image.geometry.direction;
  try {
    map.labels.resize(map.index(0, 0, map.size[2]));
  } catch (const std::bad_alloc&) {
    throw InputError(path.string() + ": not enough memory for this image; crop or resample it");
  }
  visit_voxel_type(image.type, [&]<class T>(T) {
    if constexpr (std::is_integral_v<T>) copy_labels<T>(image.bytes, path, map);
  });
  if (std::none_of(map.labels.begin(), map.labels.end(), [](std::int32_t label) { return label != 0; })) {
    throw InputError(path.string() + ": every voxel has label 0 (empty); give a segmented image");
  }
  return map;
}

GreyImage read_grey_image(const fs::path& path) {
  const VoxelImage image = read_image(path, ImageUse::grey);
  GreyImage grey{image.geometry, {}};
  visit_voxel_type(image.type, [&]<class T>(T) {
    const std::span<const T> values(reinterpret_cast<const T*>(image.bytes.data()),
                                    image.bytes.size() / sizeof(T));
    grey.values.resize(values.size());
    std::transform(values.begin(), values.end(), grey.values.begin(),
                   [](T v) { return static_cast<float>(v); });
  });
  return grey;
}

VoxelImage label_image(const LabelMap& map) {
  assert(map.labels.size() == map.index(0, 0, map.size[2]));
  VoxelImage image{geometry_of(map), VoxelType::int32, {}};
  const auto [low, high] = std::minmax_element(map.labels.begin(), map.labels.end());
  if (*low >= 0 && *high <= 255) {
    image.type = VoxelType::uint8;
  } else if (*low >= -32768 && *high <= 32767) {
    image.type = VoxelType::int16;
  }
  visit_voxel_type(image.type, [&]<class T>(T) {
    image.bytes.resize(map.labels.size() * sizeof(T));
    T* values = reinterpret_cast<T*>(image.bytes.data());
    for (std::size_t voxel = 0; voxel < map.labels.size(); ++voxel)
      values[voxel] = static_cast<T>(map.labels[voxel]);
  });
  return image;
}

void write_label_map(const fs::path& path, const LabelMap& map) {
  write_image(path, label_image(map));
}

}  // namespace sulcus
