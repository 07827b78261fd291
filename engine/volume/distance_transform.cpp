#include "engine/volume/distance_transform.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "engine/volume/large_array.h"
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

class Transform {
 public:
  Transform(const Index3& size, const Vec3& spacing, const std::vector<std::uint8_t>& links)
      : nx_(size[0]),
        ny_(size[1]),
        nz_(size[2]),
        plane_(static_cast<std::size_t>(nx_) * static_cast<std::size_t>(ny_)),
        links_(links),
        squares_{half_squares(nx_, spacing[0]), half_squares(ny_, spacing[1]), half_squares(nz_, spacing[2])},
        whole_(large_vector<float>(plane_ * static_cast<std::size_t>(nz_), 0)),
        between_(large_scratch<float>(plane_ * static_cast<std::size_t>(nz_ + 1))),
        whole_finite_(static_cast<std::size_t>(nz_)),
        between_finite_(static_cast<std::size_t>(nz_) + 1) {}

  std::vector<float> run() {
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
      std::vector<float> whole(static_cast<std::size_t>(nz_) * lanes), half(whole.size() + lanes);
#pragma omp for schedule(static)
      for (int j = 0; j < ny_; ++j) {
        for (int i = 0; i < nx_; i += lanes) stack(i, j, first, whole, half);
      }
    }
    return std::move(whole_);
  }

 private:
  // Scratch of one thread for a plane.
  struct Plane {
    explicit Plane(const Transform& t)
        : faces(static_cast<std::size_t>(t.nx_) + 17),
          list(static_cast<std::size_t>(t.nx_) + 17),
          rows(t.plane_),
          half_rows(t.plane_ + static_cast<std::size_t>(t.nx_)),
          rows_finite(static_cast<std::size_t>(t.ny_)),
          half_finite(static_cast<std::size_t>(t.ny_) + 1),
          whole(static_cast<std::size_t>(t.ny_) * lanes),
          half(whole.size() + lanes) {}
    std::vector<std::uint8_t> faces;
    std::vector<int> list;
    std::vector<float> rows, half_rows;                  // [ny][nx], [ny + 1][nx]
    std::vector<std::uint8_t> rows_finite, half_finite;  // [ny], [ny + 1]
    std::vector<int> first;                              // [ny]
    std::vector<float> whole, half;                      // a strip
  };

  const std::uint8_t* row(int j, int k) const {
    return links_.data() + (static_cast<std::size_t>(k) * ny_ + static_cast<std::size_t>(j)) * nx_;
  }

  // Faces between two neighbouring rows, `before` linked to `after` by `bit`; either may be null (image
  // border).
  bool row_faces(const std::uint8_t* before, const std::uint8_t* after, std::uint8_t bit, Plane& work) const {
    std::uint8_t* faces = work.faces.data();
    std::uint8_t any = 0;
    for (int i = 0; i < nx_; ++i) {
      const std::uint8_t b = before ? before[i] : 0, a = after ? after[i] : 0;
      faces[i] = static_cast<std::uint8_t>((a | b) & voxel_labelled && !(b & bit));
      any |= faces[i];
    }
    return any != 0;
  }

  bool scan_beside(const std::uint8_t* before, const std::uint8_t* after, std::uint8_t bit, Plane& work,
                   float* out) const {
    if (!row_faces(before, after, bit, work)) return false;
    std::memset(work.faces.data() + nx_, 0, 16);
    const int found = list_faces(work.faces.data(), nx_, work.list.data());
    fill_row(work.list.data(), found, 1, nx_, squares_[0].data(), out);
    return true;
  }

  bool scan_across(const std::uint8_t* links, Plane& work, float* out) const {
    std::uint8_t* faces = work.faces.data();
    std::memset(faces + nx_, 0, 16);
    faces[0] = links[0] & voxel_labelled;
    for (int i = 0; i + 1 < nx_; ++i) {
      faces[i + 1] =
          static_cast<std::uint8_t>((links[i] | links[i + 1]) & voxel_labelled && !(links[i] & link_i));
    }
    faces[nx_] = links[nx_ - 1] & voxel_labelled;
    const int found = list_faces(faces, nx_ + 1, work.list.data());
    if (found == 0) return false;
    fill_row(work.list.data(), found, 0, nx_, squares_[0].data(), out);
    return true;
  }

  // The pass along j over the finite rows of `work`, to plane `out`.
  void columns(Plane& work, float* out) const {
    nearest_finite(work.half_finite, ny_, work.first);
    for (int i = 0; i < nx_; i += lanes) {
      const std::size_t width = static_cast<std::size_t>(std::min(lanes, nx_ - i)) * sizeof(float);
      for (int j = 0; j < ny_; ++j) {
        float* to = work.whole.data() + static_cast<std::size_t>(j) * lanes;
        if (work.rows_finite[j]) {
          std::memcpy(to, work.rows.data() + static_cast<std::size_t>(j) * nx_ + i, width);
        } else {
          std::fill_n(to, lanes, infinite);
        }
      }
      for (int m = 0; m <= ny_; ++m) {
        float* to = work.half.data() + static_cast<std::size_t>(m) * lanes;
        if (work.half_finite[m] & 2) {
          std::memcpy(to, work.half_rows.data() + static_cast<std::size_t>(m) * nx_ + i, width);
        } else {
          std::fill_n(to, lanes, infinite);
        }
        if (work.half_finite[m] & 1) take_neighbours(work.whole.data(), m, ny_, to);
      }
      min_plus(work.whole.data(), work.half.data(), ny_, squares_[1].data(), work.first.data(),
               work.whole.data());
      for (int j = 0; j < ny_; ++j) {
        std::memcpy(out + static_cast<std::size_t>(j) * nx_ + i,
                    work.whole.data() + static_cast<std::size_t>(j) * lanes, width);
      }
    }
  }

  // half[m] = min(half[m], whole[m - 1], whole[m])
  static void take_neighbours(const float* whole, int m, int count, float* half) {
    const float* before = whole + static_cast<std::ptrdiff_t>(std::max(m - 1, 0)) * lanes;
    const float* after = whole + static_cast<std::ptrdiff_t>(std::min(m, count - 1)) * lanes;
    for (int c = 0; c < lanes; ++c) half[c] = std::min(half[c], std::min(before[c], after[c]));
  }

  // Plane k of voxel centres: faces across i and across j, edges and corners included.
  void whole_plane(int k, Plane& work) {
    bool any = false;
    for (int j = 0; j < ny_; ++j) {
      work.rows_finite[j] =
          scan_across(row(j, k), work, work.rows.data() + static_cast<std::size_t>(j) * nx_);
    }
    for (int m = 0; m <= ny_; ++m) {
      const bool scanned = scan_beside(m > 0 ? row(m - 1, k) : nullptr, m < ny_ ? row(m, k) : nullptr, link_j,
                                       work, work.half_rows.data() + static_cast<std::size_t>(m) * nx_);
      const bool beside = (m > 0 && work.rows_finite[m - 1]) || (m < ny_ && work.rows_finite[m]);
      work.half_finite[m] = static_cast<std::uint8_t>((scanned ? 2 : 0) | (beside ? 1 : 0));
      any |= work.half_finite[m] != 0;
    }
    whole_finite_[k] = any;
    if (any) columns(work, whole_.data() + static_cast<std::size_t>(k) * plane_);
  }

  // Plane between the voxel planes m - 1 and m: faces across k.
  void between_plane(int m, Plane& work) {
    bool any = false;
    for (int j = 0; j < ny_; ++j) {
      work.rows_finite[j] = scan_beside(m > 0 ? row(j, m - 1) : nullptr, m < nz_ ? row(j, m) : nullptr,
                                        link_k, work, work.rows.data() + static_cast<std::size_t>(j) * nx_);
      any |= work.rows_finite[j] != 0;
    }
    between_finite_[m] = any;
    if (!any) return;
    for (int n = 0; n <= ny_; ++n) {
      work.half_finite[n] = (n > 0 && work.rows_finite[n - 1]) || (n < ny_ && work.rows_finite[n]) ? 1 : 0;
    }
    columns(work, between_.get() + static_cast<std::size_t>(m) * plane_);
  }

  // The pass along k for a strip of stacks, and the root.
  void stack(int i, int j, const std::vector<int>& first, std::vector<float>& whole,
             std::vector<float>& half) {
    const std::size_t at = static_cast<std::size_t>(j) * nx_ + static_cast<std::size_t>(i);
    const std::size_t width = static_cast<std::size_t>(std::min(lanes, nx_ - i)) * sizeof(float);
    for (int k = 0; k < nz_; ++k) {
      float* to = whole.data() + static_cast<std::size_t>(k) * lanes;
      if (whole_finite_[k]) {
        std::memcpy(to, whole_.data() + static_cast<std::size_t>(k) * plane_ + at, width);
      } else {
        std::fill_n(to, lanes, infinite);
      }
    }
    for (int m = 0; m <= nz_; ++m) {
      float* to = half.data() + static_cast<std::size_t>(m) * lanes;
      if (between_finite_[m]) {
        std::memcpy(to, between_.get() + static_cast<std::size_t>(m) * plane_ + at, width);
      } else {
        std::fill_n(to, lanes, infinite);
      }
      take_neighbours(whole.data(), m, nz_, to);
    }
    min_plus(whole.data(), half.data(), nz_, squares_[2].data(), first.data(), whole.data());
    for (float& value : whole) value = std::sqrt(value);
    for (int k = 0; k < nz_; ++k) {
      std::memcpy(whole_.data() + static_cast<std::size_t>(k) * plane_ + at,
                  whole.data() + static_cast<std::size_t>(k) * lanes, width);
    }
  }

  int nx_, ny_, nz_;
  std::size_t plane_;
  const std::vector<std::uint8_t>& links_;
  std::vector<float> squares_[3];
  std::vector<float> whole_;          // [nz][ny][nx] planes of voxel centres
  std::unique_ptr<float[]> between_;  // [nz + 1][ny][nx] planes between them
  std::vector<std::uint8_t> whole_finite_, between_finite_;
};

}  // namespace

std::vector<float> face_distance(const Index3& size, const Vec3& spacing,
                                 const std::vector<std::uint8_t>& links) {
  return Transform(size, spacing, links).run();
}

}  // namespace sulcus
