// A scenario: one JSON file that says everything about a run. This library turns it into a Scene and its
// devices.
//
//   Scenario scenario = load_scenario("cylinder_retraction.json", {"/solver/tolerance=1e-5"});
//   Scene scene = make_scene(scenario, &warnings);
//   auto devices = make_devices(scenario);
//
// The file format is scenario.schema.json. A file with the key "based_on" is a patch (JSON Merge Patch, RFC
// 7396: objects are joined, all else is replaced, null removes) of the scenario that it names. Every key
// carries its unit; positions are world millimetres in the physical space of the image. Here everything is in
// SI units.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "device_sim/hand.h"
#include "device_sim/perturbed.h"
#include "device_sim/recorded.h"
#include "device_sim/scripted.h"
#include "engine/device/device.h"
#include "engine/numerics/error.h"
#include "engine/scene/scene.h"
#include "scenarios/loader/generated.h"

namespace sulcus {

// Where the label map comes from: a file (absolute path), or a generated body.
using LabelMapSource = std::variant<std::filesystem::path, CylinderThreeSegments, BoxSegment, SphereSegment,
                                    BallsSegment, DrawnSegments>;

// Done on the labels in the order of the list.
struct RelabelOperation {
  std::vector<std::int32_t> from;
  std::int32_t to = 0;  // 0 empties the voxels
};
struct KeepLabelsOperation {
  std::vector<std::int32_t> labels;  // all others are emptied
};
struct KeepBoxOperation {
  Vec3 min_m, max_m;  // m, world; voxels with a centre outside are emptied
};
struct PaintBoxOperation {
  Vec3 min_m, max_m;       // m, world; labelled voxels with a centre inside ...
  std::int32_t label = 0;  // ... become this; 0 empties them
};
struct LayerOperation {    // fills the separation pairs with a layer
  std::int32_t label = 0;  // of labelled voxels near a face between the two labels of a pair
  int voxels = 1;          // thickness on each side of the face
};
struct FillVoidsOperation {};  // enclosed empty voxels take the label around them
struct DropPiecesOperation {
  std::int64_t below_voxels = 0;  // pieces of fewer are emptied; 0: see below_m3
  double below_m3 = 0;            // m^3, likewise
};
struct CropOperation {
  int margin_voxels = 0;  // kept around the labelled voxels
};
struct SpeckleOperation {        // errors of a segmentation
  double share = 0;              // of the labelled voxels, drawn at random, become ...
  std::vector<std::int32_t> to;  // ... one of these, drawn at random; 0 empties them
  std::uint64_t seed = 1;
};
using LabelOperation =
    std::variant<RelabelOperation, KeepLabelsOperation, KeepBoxOperation, PaintBoxOperation, LayerOperation,
                 FillVoidsOperation, DropPiecesOperation, CropOperation, SpeckleOperation>;

// Nodes by their rest position: a box, infinite where the file says nothing. Borders belong to it. With
// labels, only nodes of cells that are made of one of them.
struct NodeRegion {
  Vec3 min_m, max_m;  // m, world
  std::vector<std::int32_t> labels;
  std::string place;  // JSON pointer, for messages
};
struct SpringRegion {
  NodeRegion nodes;
  double stiffness_N_m = 0;  // N/m at each node
  double damping_N_s_m = 0;  // N s/m at each node
};

struct ForceRegion {
  NodeRegion nodes;
  Vec3 force_N = Vec3::Zero();  // N, on all of them together
};

struct MotionRegion {
  std::string name;
  NodeRegion nodes;
  Vec3 centre_m = Vec3::Zero();  // m, world
  ScriptedTrajectory script;     // its position is the shift
};

// Where the tissue starts: a node that is not held stands at centre + gradient (X - centre).
struct InitialDeformation {
  Mat3 gradient = Mat3::Identity();
  Vec3 centre_m = Vec3::Zero();  // m, world
};

struct PlaneRegion {
  NodeRegion nodes;
  int axis = 0;  // 0..2: along which they keep their place
};

// A number taken from the run and held between bounds; what each name means is said in the schema.
struct MeasureBounds {
  std::string what, tool, path;
  double from_s = 0, to_s = std::numeric_limits<double>::infinity();  // s
  double above_Hz = 0;
  double within_rad = 0;
  Vec3 along = Vec3::UnitZ();               // any length > 0
  std::optional<double> at_least, at_most;  // in the unit that the name ends with; at least one is given
};

// A file with the motion of a hand.
struct HandFile {
  std::filesystem::path path;  // absolute; .csv or .h5
  std::string tool;            // of a recording: whose hand
};

// Who moves a tool.
struct ToolHand {
  ScriptedTrajectory script;           // a table's motion too; of a push or a recording: its start alone
  std::optional<VirtualHand> hand;     // between script and tool
  std::optional<PushScript> push;      // instead of the script
  std::optional<HandFile> file;        // where script or recording come from
  std::optional<RecordedTrajectory> recording;  // instead of the script
  std::optional<Perturbation> faults;           // on top
};

// Reads the hand of a tool out of a recording, from time 0 on; throws InputError. This library knows no recordings:
// who wants them read gives the function.
using RecordingReader = RecordedTrajectory (*)(const HandFile& file);

// Bounds on what a run may give; an absent one is not checked.
struct Checks {
  std::optional<double> max_penetration_m;  // m, deepest contact of any step
  std::optional<double> max_force_N;        // N, largest |displayed force| of any tool and step, at most
  std::optional<double> min_peak_force_N;   // N, the same, at least: the tool does touch
  std::optional<double> min_peak_displacement_m;  // m, largest displacement of a node at any step, at least
  std::optional<double> returns_to_rest_m;        // m, largest displacement of a node at the end
  std::optional<double> max_solver_error;  // relative, measure_solver_error; "solver_error" in the file
  std::optional<double> max_residual;      // relative, StepReport::residual of any step
  std::optional<std::int64_t> max_inverted_elements;                 // at any recorded frame
  std::optional<std::int64_t> min_torn_elements, max_torn_elements;  // removed by the end
  std::vector<std::int32_t> labels_stay;                             // no cell of these loses an element
  std::optional<std::int64_t> max_hanging_elements;                  // on a vertex or an edge, in any frame
  std::optional<double> min_hanging_energy_J;                        // J, peak of their kinetic energy
  std::optional<double> min_converged_share;   // of the steps, by tolerance; none: 1
  std::optional<double> max_energy_growth;     // share of the peak, while device and tools rest; none: 0.01
  std::optional<double> max_kinetic_energy_J;  // J, of the tissue at any step
  std::optional<std::int64_t> pieces_at_start, pieces_at_end;  // of the mesh, exactly
  bool contact_expected = true;                // a run in which no tool touches the tissue fails
  std::vector<MeasureBounds> measures;
};

struct ShotCamera {
  Vec3 eye_m = Vec3::Zero(), target_m = Vec3::Zero();  // m, world
  Vec3 up = Vec3::UnitZ();                             // any length > 0, not along the view
  double field_of_view_deg = 30;                       // degrees, vertical
};

enum class ShotContent { labels, max_principal_stress, displacement };

// What lies on the normal's side of a plane is taken away; the section shows the tissue as it lies there now.
struct ShotCut {
  Vec3 point_m = Vec3::Zero();   // m, world
  Vec3 normal = Vec3::UnitZ();  // any length > 0, towards the viewer
};

// The section alone, looked at along its normal.
struct ShotSlice {
  Vec3 point_m = Vec3::Zero();                          // m, world, in the middle of the picture
  Vec3 normal = Vec3::UnitZ(), up = Vec3::UnitY();  // any length > 0, not along each other
  double height_m = 0.1;                                // m, of the picture, > 0
};

struct Shot {
  std::string name;   // part of a file name: letters, digits, '_', '-'
  double time_s = 0;  // s, within the duration
  ShotContent show = ShotContent::labels;
  std::optional<std::array<double, 2>> range;  // Pa or m, of the colours; without: what there is to show
  std::optional<ShotCut> cut;                  // cut or slice, not both
  std::optional<ShotSlice> slice;
  bool grey = false;      // the section shows the grey image instead of labels
  bool contacts = false;  // contact points, and the force on each tool as an arrow
  bool golden = false;    // its picture is kept as a golden output
  ShotCamera camera;      // its own, or the pictures' common one; none of a slice
};

// An image that the tissue carries along, shown in sections.
struct GreySource {
  std::filesystem::path file;
  double black = 0, white = 255;  // values
};

struct Pictures {
  int width = 960, height = 720;  // pixels
  double arrow_m_per_N = 0.1;     // m of an arrow for each N
  std::optional<GreySource> grey;
  std::vector<Shot> shots;
};

// What is kept as golden, and how its pictures are compared: after CIELAB, as an eye would.
struct GoldenSettings {
  bool kept = true;                    // false: none, the run is judged by its statements alone
  double picture_conformity = 0.995;   // share of pixels that must look the same
  double picture_block_distance = 10;  // Delta E of the means of any 4 x 4 pixels, at most
};

struct Scenario {
  std::filesystem::path path;  // of the file (empty if the text came from elsewhere)
  std::string name, title, description;
  LabelMapSource map_source;
  std::vector<LabelOperation> map_operations;
  SceneDescription scene;  // complete but for map, fixed_nodes, springs and motions, which make_scene fills
  std::vector<NodeRegion> fixed;
  std::vector<SpringRegion> springs;
  std::vector<ForceRegion> forces;
  std::vector<PlaneRegion> planes;
  std::vector<MotionRegion> motions;
  std::optional<InitialDeformation> initial;
  std::vector<std::int32_t> prevailing_labels;  // of which a cell is made if it has any voxel of them
  std::vector<ToolHand> hands;                  // [tools]
  double duration_s = 0;                        // s; the run has steps() steps
  int measure_error_every_steps = 0;            // 0: the solver's error is not measured
  int frame_every_steps = 1;                    // recording of the whole state
  Checks checks;
  Pictures pictures;
  std::map<std::int32_t, std::array<std::uint8_t, 3>> label_colours;  // red, green, blue
  GoldenSettings golden;
  std::string resolved_json;                       // the text after the overrides, what a recording keeps
  std::vector<std::filesystem::path> input_files;  // scenario file, its base, label map, for hashing
  std::vector<std::string> warnings;  // what is odd but not wrong; for the caller to print and record

  std::int64_t steps() const;  // whole number nearest to duration / step
};

// The scenario is right, but data that it names and calls optional are not on this machine. The message says
// how to get them. A suite leaves such a scenario out and says so.
struct MissingData : EnvironmentError {
  using EnvironmentError::EnvironmentError;
};

// Reads and checks a scenario. overrides: "/json/pointer=value", value read as JSON, else as a string; the
// pointer may name a key that the file leaves out but the format knows. Throws InputError: no such file, JSON
// syntax (line and column), every violation of the schema (pointer, found, expected, nearest known key),
// values that cannot be simulated, missing label map, a hand's file that is missing, wrong or too short (file and
// line). Throws MissingData if nothing else is wrong. Without read_recording hands of recordings stay unread, and
// make_device refuses them.
Scenario load_scenario(const std::filesystem::path& path, const std::vector<std::string>& overrides = {},
                       RecordingReader read_recording = nullptr);

// The same from text, as a recording keeps it. `place` names it in messages; relative file names are looked
// up in `directory`. Files of hands are not read: a recording holds the samples, and must do without them.
Scenario load_scenario_text(const std::string& text, const std::string& place,
                            const std::filesystem::path& directory,
                            const std::vector<std::string>& overrides = {});

// The label map with its operations done; what each changed is appended to notes (if given), for the
// recording. Throws InputError.
LabelMap load_label_map(const Scenario& scenario, std::vector<std::string>* notes = nullptr);

// Label map -> mesh -> nodes of the boundary -> Scene. Appends to warnings (if given) what is odd: pairs,
// materials or colours that name absent labels, overlapping regions, a trajectory that starts inside the
// tissue's box, ... Throws InputError for what is wrong: a region without nodes, a map that is empty after
// its operations.
Scene make_scene(const Scenario& scenario, std::vector<std::string>* warnings = nullptr,
                 std::vector<std::string>* notes = nullptr);

// The device of a tool; of a scenario: one a tool, in the order of the tools.
std::unique_ptr<Device> make_device(const ToolHand& hand);
std::vector<std::unique_ptr<Device>> make_devices(const Scenario& scenario);

// The schema of the format (JSON Schema draft 7), compiled in.
const std::string& scenario_schema();

// For lists of scenarios: those in the directory and in its folder "hard", with name, title and description,
// sorted by path; a file that is no valid scenario gets its error in `error`.
struct ScenarioSummary {
  std::filesystem::path path;
  std::string name, title, description;
  std::string error;    // empty if the file is valid
  std::string missing;  // optional data that are not here; else empty
};
std::vector<ScenarioSummary> list_scenarios(const std::filesystem::path& directory);

}  // namespace sulcus
