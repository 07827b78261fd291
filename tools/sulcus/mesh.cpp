#include <charconv>
#include <cstdio>
#include <fstream>
#include <set>
#include <sstream>

#include "engine/mesh/topology.h"
#include "engine/numerics/error.h"
#include "scenarios/loader/images.h"
#include "tools/sulcus/commands.h"
#include "tools/sulcus/support.h"

namespace sulcus {
namespace {

// Pairs of a text file: two labels a line; '#' starts a comment, '[...]' a heading.
SeparationPairs read_pairs(const std::filesystem::path& path) {
  std::ifstream file(path);
  if (!file) throw InputError(path.string() + ": cannot be read; give a text file with two labels a line");
  std::vector<std::pair<std::int32_t, std::int32_t>> pairs;
  std::string line;
  for (int number = 1; std::getline(file, line); ++number) {
    line = line.substr(0, line.find('#'));
    std::istringstream words(line);
    std::string first, second, more;
    if (!(words >> first) || first.front() == '[') continue;
    const auto label = [&](const std::string& word) {
      std::int32_t value = 0;
      const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
      if (error != std::errc() || end != word.data() + word.size()) {
        throw InputError(path.string() + ":" + std::to_string(number) + ": \"" + line +
                         "\" is not a pair; give two whole numbers a line");
      }
      return value;
    };
    words >> second;
    if (words >> more) second = more;  // three words are no pair: refused by label() below
    if (!more.empty()) second += "?";
    pairs.emplace_back(label(first), label(second));
  }
  return make_separation_pairs(std::move(pairs));
}

template <class Number>
void write_array(std::ostream& out, const char* type, const char* name, int components,
                 const std::vector<Number>& values) {
  out << "<DataArray type=\"" << type << "\" Name=\"" << name << "\" NumberOfComponents=\"" << components
      << "\" format=\"ascii\">\n";
  for (std::size_t i = 0; i < values.size(); ++i) out << +values[i] << ((i + 1) % 12 == 0 ? '\n' : ' ');
  out << "\n</DataArray>\n";
}

// VTK's XML format for unstructured grids, in metres.
std::string vtu_text(const EmbeddingMesh& mesh) {
  std::vector<double> points;
  for (const Vec3& x : mesh.rest_positions) points.insert(points.end(), {x[0], x[1], x[2]});
  std::vector<std::int32_t> connectivity, offsets, label, cell;
  std::vector<int> types(mesh.tets.size(), 10);  // VTK_TETRA
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    connectivity.insert(connectivity.end(), mesh.tets[t].begin(), mesh.tets[t].end());
    offsets.push_back(static_cast<std::int32_t>(connectivity.size()));
    const auto c = t / static_cast<std::size_t>(mesh.tets_per_cell);
    label.push_back(mesh.cell_label[c]);
    cell.push_back(static_cast<std::int32_t>(c));
  }
  const Pieces pieces = mesh_pieces(mesh.tets, static_cast<std::int64_t>(mesh.rest_positions.size()));
  std::ostringstream out;
  out.precision(9);
  out << "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"0.1\" "
         "byte_order=\"LittleEndian\">\n"
      << "<UnstructuredGrid>\n<Piece NumberOfPoints=\"" << mesh.rest_positions.size() << "\" NumberOfCells=\""
      << mesh.tets.size() << "\">\n<Points>\n";
  write_array(out, "Float64", "position_m", 3, points);
  out << "</Points>\n<Cells>\n";
  write_array(out, "Int32", "connectivity", 1, connectivity);
  write_array(out, "Int32", "offsets", 1, offsets);
  write_array(out, "UInt8", "types", 1, types);
  out << "</Cells>\n<CellData Scalars=\"label\">\n";
  write_array(out, "Int32", "label", 1, label);
  write_array(out, "Int32", "hexahedron", 1, cell);
  write_array(out, "Int32", "piece", 1, pieces.piece);
  out << "</CellData>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>\n";
  return out.str();
}

}  // namespace

int mesh_command(const MeshOptions& options) {
  const LabelMap map = read_label_map(options.label_map);
  const SeparationPairs pairs = options.pairs.empty() ? SeparationPairs{} : read_pairs(options.pairs);
  const std::set<std::int32_t> present(map.labels.begin(), map.labels.end());
  for (const auto& [a, b] : pairs.pairs) {
    if (!present.contains(a) || !present.contains(b)) {
      std::fprintf(stderr, "warning: pair %d %d names a label that the map does not have\n", a, b);
    }
  }
  EmbeddingOptions embedding;
  embedding.size_m = options.size_mm * 1e-3;
  embedding.split = options.split == "six" ? TetSplit::six : TetSplit::five;
  embedding.min_island_cells = options.min_island_cells;
  const EmbeddingMesh mesh = build_embedding(map, pairs, embedding);
  write_file_atomically(options.out, vtu_text(mesh));
  std::printf(
      "%s: %zu cells, %zu nodes, %zu tetrahedra, %zu pieces\n", options.out.c_str(), mesh.cell_nodes.size(),
      mesh.rest_positions.size(), mesh.tets.size(),
      mesh_pieces(mesh.tets, static_cast<std::int64_t>(mesh.rest_positions.size())).item_count.size());
  return 0;
}

int list_command(const std::filesystem::path& directory) {
  int code = 0;
  for (const ScenarioSummary& scenario : list_scenarios(directory)) {
    if (scenario.error.empty()) {
      const char* note = scenario.missing.empty() ? "" : " (its optional data are not here)";
      std::printf("%-28s %s%s\n", scenario.name.c_str(), scenario.title.c_str(), note);
    } else {
      std::printf("%-28s not valid: %s\n", scenario.path.stem().c_str(), scenario.error.c_str());
      code = 2;
    }
  }
  return code;
}

}  // namespace sulcus
