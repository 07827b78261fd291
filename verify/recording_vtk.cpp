#include "verify/recording_vtk.h"

#include <array>
#include <numeric>

namespace sulcus {
namespace {

using hdf5::checked;
using hdf5::Handle;

constexpr std::uint8_t vtk_tetra = 10;

Handle space_of(std::span<const hsize_t> extent) {
  return {
      checked(H5Screate_simple(static_cast<int>(extent.size()), extent.data(), nullptr), "preparing HDF5"),
      H5Sclose};
}

// A dataset that is another one of the same file, seen in another shape.
void write_view(hid_t file, const std::string& path, const std::string& of, std::span<const hsize_t> extent) {
  const Handle source(checked(H5Dopen2(file, of.c_str(), H5P_DEFAULT), of), H5Dclose);
  const Handle type(checked(H5Dget_type(source), of), H5Tclose);
  const Handle source_space(checked(H5Dget_space(source), of), H5Sclose);
  const Handle space = space_of(extent);
  const Handle creation(checked(H5Pcreate(H5P_DATASET_CREATE), path), H5Pclose);
  checked(H5Pset_virtual(creation, space, ".", of.c_str(), source_space), path);
  Handle view(checked(H5Dcreate2(file, path.c_str(), type, space, H5P_DEFAULT, creation, H5P_DEFAULT), path),
              H5Dclose);
  if (!view.close()) throw hdf5::Failure(path + ": " + hdf5::innermost_error());
}

template <class T>
void write_table(hid_t file, const std::string& path, std::span<const hsize_t> extent,
                 const std::vector<T>& values) {
  const Handle space = space_of(extent);
  Handle table(checked(H5Dcreate2(file, path.c_str(), hdf5::file_type<T>(), space, H5P_DEFAULT, H5P_DEFAULT,
                                  H5P_DEFAULT),
                       path),
               H5Dclose);
  checked(H5Dwrite(table, hdf5::memory_type<T>(), H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()), path);
  if (!table.close()) throw hdf5::Failure(path + ": " + hdf5::innermost_error());
}

template <class T>
void write_list(hid_t file, const std::string& path, const std::vector<T>& values) {
  const hsize_t extent[] = {values.size()};
  write_table(file, path, extent, values);
}

// 0, width, 2 width, ...: where each frame begins.
std::vector<std::int64_t> offsets(std::size_t frames, std::int64_t width) {
  std::vector<std::int64_t> starts(frames);
  for (std::size_t f = 0; f < frames; ++f) starts[f] = static_cast<std::int64_t>(f) * width;
  return starts;
}

void write_head(hid_t group) {
  const std::int64_t version[] = {1, 0};
  const hsize_t two[] = {2};
  const Handle pair = space_of(two);
  Handle attribute(
      checked(H5Acreate2(group, "Version", hdf5::file_type<std::int64_t>(), pair, H5P_DEFAULT, H5P_DEFAULT),
              "Version"),
      H5Aclose);
  checked(H5Awrite(attribute, hdf5::memory_type<std::int64_t>(), version), "Version");
  attribute.close();
  // VTK compares this text as ASCII
  const std::string name = "UnstructuredGrid";
  const Handle text(checked(H5Tcopy(H5T_C_S1), "Type"), H5Tclose);
  checked(H5Tset_size(text, name.size()), "Type");
  const Handle scalar(checked(H5Screate(H5S_SCALAR), "Type"), H5Sclose);
  Handle type(checked(H5Acreate2(group, "Type", text, scalar, H5P_DEFAULT, H5P_DEFAULT), "Type"), H5Aclose);
  checked(H5Awrite(type, text, name.data()), "Type");
}

}  // namespace

void write_vtk_group(hid_t file, const RunHeader& header, std::span<const double> times) {
  const auto nodes = header.node_count(), tets = header.tet_count();
  const auto n = static_cast<hsize_t>(nodes), t = static_cast<hsize_t>(tets);
  const std::size_t frames = times.size();
  const Handle group = hdf5::create_group(file, "/VTKHDF");
  for (const char* name : {"/VTKHDF/CellData", "/VTKHDF/PointData", "/VTKHDF/Steps/CellDataOffsets",
                           "/VTKHDF/Steps/PointDataOffsets"})
    hdf5::create_group(file, name);
  write_head(group);

  // the mesh, which is the same in all frames
  write_list<std::int64_t>(file, "/VTKHDF/NumberOfPoints", {nodes});
  write_list<std::int64_t>(file, "/VTKHDF/NumberOfCells", {tets});
  write_list<std::int64_t>(file, "/VTKHDF/NumberOfConnectivityIds", {4 * tets});
  checked(H5Lcreate_hard(file, "/mesh/tets", file, "/VTKHDF/Connectivity", H5P_DEFAULT, H5P_DEFAULT),
          "/VTKHDF/Connectivity");
  std::vector<std::int32_t> first_corner(t + 1);  // of the type of the connectivity, as VTK asks
  for (std::size_t i = 0; i <= t; ++i) first_corner[i] = static_cast<std::int32_t>(4 * i);
  write_list(file, "/VTKHDF/Offsets", first_corner);
  write_list(file, "/VTKHDF/Types", std::vector<std::uint8_t>(t, vtk_tetra));

  // what changes; readers that know no steps show the first frame
  const hsize_t points[] = {frames * n, 3}, cells[] = {frames * t}, rest[] = {n, 3};
  write_view(file, "/VTKHDF/Points", "/frames/positions_m", points);
  write_view(file, "/VTKHDF/CellData/stress_Pa", "/frames/stress_Pa", cells);
  write_view(file, "/VTKHDF/CellData/alive", "/frames/alive", cells);
  write_view(file, "/VTKHDF/PointData/rest_position_m", "/mesh/rest_positions_m", rest);

  const Handle steps = hdf5::create_group(file, "/VTKHDF/Steps");
  hdf5::write_attribute(steps, "NSteps", static_cast<std::int64_t>(frames));
  const std::vector<std::int64_t> none(frames, 0), one(frames, 1);
  const hsize_t column[] = {frames, 1};
  write_list(file, "/VTKHDF/Steps/Values", std::vector<double>(times.begin(), times.end()));
  write_list(file, "/VTKHDF/Steps/PartOffsets", none);
  write_list(file, "/VTKHDF/Steps/NumberOfParts", one);
  write_list(file, "/VTKHDF/Steps/PointOffsets", offsets(frames, nodes));
  write_table(file, "/VTKHDF/Steps/CellOffsets", column, none);
  write_table(file, "/VTKHDF/Steps/ConnectivityIdOffsets", column, none);
  write_list(file, "/VTKHDF/Steps/CellDataOffsets/stress_Pa", offsets(frames, tets));
  write_list(file, "/VTKHDF/Steps/CellDataOffsets/alive", offsets(frames, tets));
  write_list(file, "/VTKHDF/Steps/PointDataOffsets/rest_position_m", none);
}

}  // namespace sulcus
