#include "engine/volume/distance_transform.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#if defined(__SSE2__)
#include <emmintrin.h>
#endif

#include "engine/volume/min_plus.h"
#include "engine/volume/voxel_links.h"

namespace sulcus {

namespace {

constexpr float infinite = std::numeric_limits<float>::infinity();
constexpr int lanes = min_plus_lanes;

// ((n + 1/2) step)^2 for n = 0 .. count + 1, m^2
std::vector<float> half_squares(int count, double step) {
  std::vector<float> squares(static_cast<std::size_t>(count) + 2);
  for (std::size_t n = 0; n < squares.size(); ++n) {
    const double distance = (static_cast<double>(n) + 0.5) * step;
    squares[n] = static_cast<float>(distance * distance);
  }
  return squares;
}

// For each of `count` rows: how far the nearest half row with finite numbers is; half row m lies before row
// m.
void nearest_finite(const std::vector<std::uint8_t>& finite, int count, std::vector<int>& first) {
  first.assign(static_cast<std::size_t>(count), count);
  for (int n = 0, last = -1; n < count; ++n) {
    if (finite[n]) last = n;
    if (last >= 0) first[n] = n - last;
  }
  for (int n = count - 1, last = -1; n >= 0; --n) {
    if (finite[n + 1]) last = n + 1;
    if (last >= 0) first[n] = std::min(first[n], last - n - 1);
  }
}

// Numbers of the non-zero bytes, eight bytes a look; rows are padded with 8 zero bytes.
int list_faces(const std::uint8_t* faces, int count, int* list) {
  int found = 0;
  for (int m = 0; m < count; m += 8) {
    std::uint64_t eight = 0;
    std::memcpy(&eight, faces + m, 8);
    if (!eight) continue;
    for (int b = m; b < m + 8; ++b) {
      if (faces[b]) list[found++] = b;
    }
  }
  return found;
}

// Squared distance along a row to the faces in `list`. A face m of width 0 stands between the voxels m - 1
// and m (across the row); one of width 1 lies beside the whole voxel m.
void fill_row(const int* list, int found, int width, int count, const float* squares, float* out) {
  for (int i = 0; i < list[0]; ++i) out[i] = squares[list[0] - 1 - i];
  for (int f = 0; f < found; ++f) {
    const int begin = list[f] + width, end = f + 1 < found ? list[f + 1] : count;
    if (width == 1) out[list[f]] = 0;
    if (f + 1 < found) {
      for (int i = begin; i < end; ++i) out[i] = std::min(squares[i - begin], squares[end - 1 - i]);
    } else {
      for (int i = begin; i < end; ++i) out[i] = squares[i - begin];
    }
  }
}

// Four roots at a time: the compiler would take one by one, minding errno. Square roots are correctly
// rounded, so the bits are the same.
void root_row(const float* from, int count, float* to) {
  int c = 0;
#if defined(__SSE2__)
  for (; c + 4 <= count; c += 4) _mm_storeu_ps(to + c, _mm_sqrt_ps(_mm_loadu_ps(from + c)));
#endif
  for (; c < count; ++c) to[c] = std::sqrt(from[c]);
}

class Transform {
 public:
  Transform(const Index3& size, const Vec3& spacing, const VoxelLinks& links)
      : nx_(size[0]),
        ny_(size[1]),
        nz_(size[2]),
        plane_(static_cast<std::size_t>(nx_) * static_cast<std::size_t>(ny_)),
        links_(links),
        squares_{half_squares(nx_, spacing[0]), half_squares(ny_, spacing[1]), half_squares(nz_, spacing[2])},
        whole_(plane_ * static_cast<std::size_t>(nz_)),
        between_(plane_ * static_cast<std::size_t>(nz_ + 1)),
        labelled_(static_cast<std::size_t>(ny_) * static_cast<std::size_t>(nz_)),
        whole_finite_(static_cast<std::size_t>(nz_)),
        between_finite_(static_cast<std::size_t>(nz_) + 1) {}

  LargeVector<float> run() {
#pragma omp parallel
    {
      Plane work(*this);
#pragma omp for schedule(static, 1)
      for (int k = 0; k < nz_; ++k) whole_plane(k, work);
#pragma omp for schedule(static, 1)
      for (int m = 0; m <= nz_; ++m) between_plane(m, work);
    }
    std::vector<std::uint8_t> finite(static_cast<std::size_t>(nz_) + 1);
    for (int m = 0; m <= nz_; ++m) {
      finite[m] = between_finite_[m] || (m > 0 && whole_finite_[m - 1]) || (m < nz_ && whole_finite_[m]);
    }
    std::vector<int> first;
    nearest_finite(finite, nz_, first);
#pragma omp parallel
    {
      std::vector<float> whole(static_cast<std::size_t>(nz_) * stack_stride),
          half(whole.size() + stack_stride);
#pragma omp for schedule(static, 2)
      for (int j = 0; j < ny_; ++j) {
        for (int i = 0; i < nx_; i += stack_width) stacks(i, j, first, whole.data(), half.data());
      }
    }
    return std::move(whole_);
  }

 private:
  // Rows stand an odd number of cache lines apart, so that they spread over the whole cache.
  static constexpr int line = 16, stack_width = 2 * lanes, stack_stride = stack_width + line;

  // Scratch of one thread for a plane.
  struct Plane {
    explicit Plane(const Transform& t)
        : stride((t.nx_ + lanes - 1) / lanes * lanes + line),
          faces(static_cast<std::size_t>(t.nx_) + 17),
          nothing(static_cast<std::size_t>(t.nx_)),
          list(static_cast<std::size_t>(t.nx_) + 17),
          rows(static_cast<std::size_t>(stride) * t.ny_),
          half_rows(rows.size() + stride),
          half_finite(static_cast<std::size_t>(t.ny_) + 1) {}
    std::ptrdiff_t stride;
    std::vector<std::uint8_t> faces, nothing;
    std::vector<int> list;
    std::vector<float> rows, half_rows;     // [ny][stride], [ny + 1][stride]
    std::vector<std::uint8_t> half_finite;  // [ny + 1]
    std::vector<int> first;                 // [ny]
  };

  const std::uint8_t* row(int j, int k) const {
    return links_.data() + (static_cast<std::size_t>(k) * ny_ + static_cast<std::size_t>(j)) * nx_;
  }

  bool labelled(int j, int k) const {
    return labelled_[static_cast<std::size_t>(k) * ny_ + static_cast<std::size_t>(j)] != 0;
  }

  bool plane_labelled(int k) const {
    const std::uint8_t* plane = labelled_.data() + static_cast<std::ptrdiff_t>(k) * ny_;
    return k >= 0 && k < nz_ && std::any_of(plane, plane + ny_, [](std::uint8_t any) { return any != 0; });
  }

  // Row (j, k), or null where nothing is in it: at the image's border, and where no voxel is labelled.
  const std::uint8_t* row_with_voxels(int j, int k) const {
    return j >= 0 && j < ny_ && k >= 0 && k < nz_ && labelled(j, k) ? row(j, k) : nullptr;
  }

  // Distances along a row to the faces between two neighbouring rows, `before` linked to `after` by bit
  // `axis`; either may be null. Infinite, and false, without a face.
  bool scan_beside(const std::uint8_t* before, const std::uint8_t* after, int axis, Plane& work,
                   float* out) const {
    if (!before && !after) return fill(0, 1, work, out);
    std::uint8_t* faces = work.faces.data();
    std::memset(faces + nx_, 0, 16);
    if (!before) before = work.nothing.data();
    if (!after) after = work.nothing.data();
    std::uint8_t any = 0;
    for (int i = 0; i < nx_; ++i) {  // labelled is bit 3
      const auto b = before[i], a = after[i];
      const auto face = static_cast<std::uint8_t>(((a | b) >> 3) & ~(b >> axis) & 1);
      faces[i] = face;
      any |= face;
    }
    const int found = any ? list_faces(faces, nx_, work.list.data()) : 0;
    return fill(found, 1, work, out);
  }

  // Distances along a row to the faces across it.
  bool scan_across(const std::uint8_t* links, Plane& work, float* out) const {
    std::uint8_t* faces = work.faces.data();
    std::memset(faces + nx_, 0, 16);
    std::uint8_t any = faces[0] = links[0] >> 3;
    for (int i = 0; i + 1 < nx_; ++i) {
      const auto face = static_cast<std::uint8_t>(((links[i] | links[i + 1]) >> 3) & ~links[i] & 1);
      faces[i + 1] = face;
      any |= face;
    }
    any |= faces[nx_] = links[nx_ - 1] >> 3;
    const int found = any ? list_faces(faces, nx_ + 1, work.list.data()) : 0;
    return fill(found, 0, work, out);
  }

  bool fill(int found, int width, const Plane& work, float* out) const {
    if (found > 0) {
      fill_row(work.list.data(), found, width, nx_, squares_[0].data(), out);
    } else {
      std::fill_n(out, nx_, infinite);
    }
    return found > 0;
  }

  // The pass along j over the rows of `work`, to plane `out`.
  void columns(Plane& work, float* out) const {
    take_neighbours(work.rows.data(), work.half_rows.data(), work.stride, ny_, nx_);
    nearest_finite(work.half_finite, ny_, work.first);
    for (int i = 0; i < nx_; i += lanes) {
      min_plus(work.rows.data() + i, work.half_rows.data() + i, work.stride, ny_, squares_[1].data(),
               work.first.data());
    }
    for (int j = 0; j < ny_; ++j) {
      std::memcpy(out + static_cast<std::size_t>(j) * nx_, work.rows.data() + j * work.stride,
                  static_cast<std::size_t>(nx_) * sizeof(float));
    }
  }

  // Plane k of voxel centres: faces across i and across j, edges and corners included.
  void whole_plane(int k, Plane& work) {
    std::fill(work.half_finite.begin(), work.half_finite.end(), 0);
    for (int j = 0; j < ny_; ++j) {
      std::uint8_t any = 0;
      for (int i = 0; i < nx_; ++i) any |= row(j, k)[i];
      labelled_[static_cast<std::size_t>(k) * ny_ + static_cast<std::size_t>(j)] = any;
    }
    if (!plane_labelled(k)) return;
    for (int j = 0; j < ny_; ++j) {
      if (!labelled(j, k)) {
        fill(0, 0, work, work.rows.data() + j * work.stride);
      } else if (scan_across(row(j, k), work, work.rows.data() + j * work.stride)) {
        work.half_finite[j] = work.half_finite[j + 1] = 1;
      }
    }
    for (int m = 0; m <= ny_; ++m) {
      work.half_finite[m] |= scan_beside(row_with_voxels(m - 1, k), row_with_voxels(m, k), 1, work,
                                         work.half_rows.data() + m * work.stride);
    }
    whole_finite_[k] = *std::max_element(work.half_finite.begin(), work.half_finite.end());
    if (whole_finite_[k]) columns(work, whole_.data() + static_cast<std::size_t>(k) * plane_);
  }

  // Plane between the voxel planes m - 1 and m: faces across k.
  void between_plane(int m, Plane& work) {
    if (!plane_labelled(m - 1) && !plane_labelled(m)) return;
    std::fill(work.half_finite.begin(), work.half_finite.end(), 0);
    for (int j = 0; j < ny_; ++j) {
      if (scan_beside(row_with_voxels(j, m - 1), row_with_voxels(j, m), 2, work,
                      work.rows.data() + j * work.stride)) {
        work.half_finite[j] = work.half_finite[j + 1] = 1;
      }
    }
    between_finite_[m] = *std::max_element(work.half_finite.begin(), work.half_finite.end());
    if (!between_finite_[m]) return;
    std::fill(work.half_rows.begin(), work.half_rows.end(), infinite);
    columns(work, between_.data() + static_cast<std::size_t>(m) * plane_);
  }

  // The pass along k for a few stacks side by side, and the root.
  void stacks(int i, int j, const std::vector<int>& first, float* whole, float* half) {
    const std::size_t at = static_cast<std::size_t>(j) * nx_ + static_cast<std::size_t>(i);
    const int width = std::min(stack_width, nx_ - i);
    const auto gather = [&](bool finite, const float* plane, float* to) {
      if (finite) {
        std::copy_n(plane + at, width, to);
      } else {
        std::fill_n(to, width, infinite);
      }
    };
    for (int k = 0; k < nz_; ++k) {
      gather(whole_finite_[k], whole_.data() + static_cast<std::size_t>(k) * plane_,
             whole + k * stack_stride);
    }
    for (int m = 0; m <= nz_; ++m) {
      gather(between_finite_[m], between_.data() + static_cast<std::size_t>(m) * plane_,
             half + m * stack_stride);
    }
    take_neighbours(whole, half, stack_stride, nz_, width);
    for (int strip = 0; strip < width; strip += lanes) {
      min_plus(whole + strip, half + strip, stack_stride, nz_, squares_[2].data(), first.data());
    }
    for (int k = 0; k < nz_; ++k) {
      const float* from = whole + k * stack_stride;
      float* to = whole_.data() + static_cast<std::size_t>(k) * plane_ + at;
      root_row(from, width, to);
    }
  }

  int nx_, ny_, nz_;
  std::size_t plane_;
  const VoxelLinks& links_;
  std::vector<float> squares_[3];
  LargeVector<float> whole_;            // [nz][ny][nx] planes of voxel centres
  LargeVector<float> between_;          // [nz + 1][ny][nx] planes between them
  std::vector<std::uint8_t> labelled_;  // [nz][ny] rows in which any voxel is
  std::vector<std::uint8_t> whole_finite_, between_finite_;
};

}  // namespace

LargeVector<float> face_distance(const Index3& size, const Vec3& spacing, const VoxelLinks& links) {
  return Transform(size, spacing, links).run();
}

}  // namespace sulcus
