#include "scenarios/loader/image_itk.h"

#include "engine/numerics/error.h"

namespace sulcus {

namespace fs = std::filesystem;

std::string reason(const itk::ExceptionObject& error) {
  std::string text = error.GetDescription();
  for (char& c : text) c = c == '\n' || c == '\r' ? ' ' : c;
  if (text.rfind("ITK ERROR: ", 0) == 0) text = text.substr(11);
  return text.substr(0, 300);
}

itk::ImageIORegion whole_region(const itk::ImageIOBase& io) {
  itk::ImageIORegion region(io.GetNumberOfDimensions());
  for (unsigned axis = 0; axis < io.GetNumberOfDimensions(); ++axis) {
    region.SetIndex(axis, 0);
    region.SetSize(axis, io.GetDimensions(axis));
  }
  return region;
}

void set_geometry(const ImageGeometry& geometry, itk::ImageIOBase& io) {
  io.SetNumberOfDimensions(3);
  for (unsigned axis = 0; axis < 3; ++axis) {
    io.SetDimensions(axis, static_cast<itk::SizeValueType>(geometry.size[axis]));
    io.SetSpacing(axis, geometry.spacing[axis] * 1000);
    io.SetOrigin(axis, geometry.origin[axis] * 1000);
    const Vec3 direction = geometry.direction.col(axis);
    io.SetDirection(axis, std::vector<double>{direction[0], direction[1], direction[2]});
  }
}

void take_geometry(const fs::path& path, const Vec3& spacing_mm, const Vec3& origin_mm, const Mat3& direction,
                   ImageGeometry& geometry) {
  for (int axis = 0; axis < 3; ++axis) {
    if (!(spacing_mm[axis] >= 1e-3 && spacing_mm[axis] <= 1e3)) {
      throw InputError(path.string() + ": the spacing along axis " + std::to_string(axis) + " is " +
                       std::to_string(spacing_mm[axis]) + " mm; expected 0.001 to 1000 mm");
    }
  }
  const Mat3 product = direction.transpose() * direction;
  if (!origin_mm.allFinite() || !((product - Mat3::Identity()).cwiseAbs().maxCoeff() <= 1e-4)) {
    throw InputError(
        path.string() +
        ": the image's axes are not orthonormal (a sheared image) or its origin is not finite; resample "
        "the image onto a right-angled grid");
  }
  geometry.spacing = spacing_mm / 1000;
  geometry.origin = origin_mm / 1000;
  geometry.direction = direction;
}

void check_voxel_count(const fs::path& path, const Index3& size) {
  double voxels = 1;
  for (const int side : size) voxels *= static_cast<double>(side);
  if (!(voxels >= 1)) throw InputError(path.string() + ": the image has no voxels");
  if (voxels > static_cast<double>(max_image_voxels)) {
    throw InputError(path.string() + ": the header promises " + std::to_string(size[0]) + " x " +
                     std::to_string(size[1]) + " x " + std::to_string(size[2]) + " voxels; at most " +
                     std::to_string(max_image_voxels) + " are taken: crop or resample the image");
  }
}

itk::IOComponentEnum itk_component(VoxelType type) {
  using Component = itk::IOComponentEnum;
  constexpr Component components[] = {Component::CHAR,  Component::UCHAR, Component::SHORT, Component::USHORT,
                                      Component::INT,   Component::UINT,  Component::LONG,  Component::ULONG,
                                      Component::FLOAT, Component::DOUBLE};
  static_assert(sizeof(long) == 8);
  return components[static_cast<int>(type)];
}

VoxelType voxel_type(itk::IOComponentEnum component, const fs::path& path) {
  using Component = itk::IOComponentEnum;
  switch (component) {
    case Component::CHAR:
      return VoxelType::int8;
    case Component::UCHAR:
      return VoxelType::uint8;
    case Component::SHORT:
      return VoxelType::int16;
    case Component::USHORT:
      return VoxelType::uint16;
    case Component::INT:
      return VoxelType::int32;
    case Component::UINT:
      return VoxelType::uint32;
    case Component::LONG:
    case Component::LONGLONG:
      return VoxelType::int64;
    case Component::ULONG:
    case Component::ULONGLONG:
      return VoxelType::uint64;
    case Component::FLOAT:
      return VoxelType::float32;
    case Component::DOUBLE:
      return VoxelType::float64;
    default:
      throw InputError(path.string() +
                       ": the type of the voxels is unknown; store them as integers (int16, say)");
  }
}

}  // namespace sulcus
