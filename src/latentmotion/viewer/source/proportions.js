// The drawn person: how a body rests, and the sizes of what lies around its bones.
//
// Meters; +x is the body's left, y is up, +z is ahead. Only left sides are drawn; right ones mirror.

/** Direction of the bone that ends in a joint, in the resting body. */
export const REST = {
  left_hip: [0.62, -0.77, -0.08],
  spine1: [0, 0.97, -0.16],
  left_knee: [0.16, -0.99, 0.02],
  spine2: [0, 0.99, 0.1],
  left_ankle: [0.06, -0.99, -0.07],
  spine3: [0, 1, 0.03],
  left_foot: [0.16, -0.34, 0.93],
  neck: [0, 0.985, -0.15],
  left_collar: [0.55, 0.83, -0.08],
  head: [0, 0.93, 0.36],
  left_shoulder: [0.95, 0.3, -0.1],
  left_elbow: [0.66, -0.75, -0.05],
  left_wrist: [0.62, -0.76, 0.18],
};

/** Three joints that move as one piece; together they fix a bone's rotation, twist included. */
export const FRAMES = {
  pelvis: ["right_hip", "left_hip", "spine1"],
  spine3: ["right_collar", "left_collar", "neck"],
  left_ankle: ["left_ankle", "left_foot", "left_knee"],
  right_ankle: ["right_ankle", "right_foot", "right_knee"],
};

// [bone, from, to, radius, radius]: a cone with round ends. A place is a joint; a joint and a shift;
// or two joints and the part of the way between them.
export const CONES = [
  ["neck", ["neck", 0, -0.03, -0.005], ["head", 0, 0.03, -0.018], 0.054, 0.053],
  ["spine3", ["neck", 0.02, -0.02, -0.02], ["left_shoulder", -0.02, 0.012, 0], 0.046, 0.044],
  ["left_collar", ["left_collar", 0.03, 0, 0], ["left_shoulder"], 0.05, 0.053],
  ["left_shoulder", ["left_shoulder", 0.01, -0.006, 0], ["left_shoulder", "left_elbow", 0.42], 0.06, 0.049],
  ["left_shoulder", ["left_shoulder", "left_elbow", 0.42], ["left_elbow"], 0.049, 0.038],
  ["left_elbow", ["left_elbow"], ["left_elbow", "left_wrist", 0.25], 0.037, 0.0395],
  ["left_elbow", ["left_elbow", "left_wrist", 0.25], ["left_wrist"], 0.0395, 0.026],
  ["left_hip", ["left_hip", 0.022, -0.03, 0], ["left_hip", "left_knee", 0.5], 0.088, 0.072],
  ["left_hip", ["left_hip", "left_knee", 0.5], ["left_knee", 0, 0.01, 0.004], 0.072, 0.053],
  ["left_knee", ["left_knee", 0, 0.01, 0.004], ["left_knee", 0, -0.13, -0.016], 0.053, 0.0525],
  ["left_knee", ["left_knee", 0, -0.13, -0.016], ["left_ankle", 0, 0.02, 0], 0.0525, 0.034],
  ["left_ankle", ["left_ankle", 0, 0.01, -0.004], ["left_ankle", 0, -0.035, -0.03], 0.033, 0.034],
  ["left_ankle", ["left_ankle"], ["left_foot", -0.002, 0.01, 0], 0.037, 0.03],
  ["left_ankle", ["left_ankle", 0, -0.04, -0.02], ["left_foot", 0.006, -0.004, 0], 0.03, 0.036],
  ["left_foot", ["left_foot", -0.012, -0.004, 0], ["left_foot", 0, -0.01, 0.062], 0.033, 0.02],
  ["left_foot", ["left_foot", 0.02, -0.006, -0.01], ["left_foot", 0.028, -0.01, 0.04], 0.03, 0.018],
];

// [bone, joint, shift, half axes]: an upright ellipsoid.
export const ELLIPSOIDS = [
  ["pelvis", "left_hip", [0.012, -0.03, -0.052], [0.08, 0.08, 0.072]],
  ["spine3", "left_collar", [0.015, -0.045, 0.042], [0.088, 0.07, 0.04]],
  ["spine3", "left_shoulder", [-0.07, -0.06, -0.03], [0.052, 0.1, 0.05]],
  ["head", "head", [0, 0.098, -0.004], [0.08, 0.104, 0.1]],
  ["head", "head", [0, 0.115, -0.016], [0.082, 0.095, 0.095]],
  ["head", "head", [0, 0.035, 0.04], [0.053, 0.062, 0.058]],
  ["head", "head", [0, 0.058, 0.1], [0.012, 0.021, 0.017]],
  ["head", "left_ear", [0, 0, 0], [0.01, 0.027, 0.018]],
];
export const EAR = [0.08, 0.065, -0.004]; // from the joint of the head

// The trunk, from below: [joint, height above it, half width, depth ahead, depth behind].
export const TRUNK = [
  ["pelvis", -0.16, 0.03, 0.03, 0.03],
  ["pelvis", -0.125, 0.105, 0.07, 0.075],
  ["pelvis", -0.06, 0.158, 0.097, 0.105],
  ["pelvis", 0.03, 0.156, 0.106, 0.1],
  ["spine1", 0.0, 0.137, 0.112, 0.075],
  ["spine2", -0.01, 0.142, 0.113, 0.094],
  ["spine3", 0.03, 0.157, 0.118, 0.112],
  ["spine3", 0.12, 0.155, 0.118, 0.108],
  ["neck", -0.05, 0.115, 0.085, 0.075],
  ["neck", -0.01, 0.06, 0.05, 0.05],
  ["neck", 0.03, 0.02, 0.02, 0.02],
];

// What carries the trunk's skin: [bone, joint, shift, half axes], as above but unseen.
export const CORE = [
  ["pelvis", "pelvis", [0, -0.05, 0], [0.15, 0.1, 0.1]],
  ["spine1", "spine1", [0, 0.02, 0], [0.13, 0.07, 0.09]],
  ["spine2", "spine2", [0, 0.0, 0], [0.13, 0.06, 0.09]],
  ["spine3", "spine3", [0, 0.1, 0], [0.15, 0.14, 0.1]],
];

// Hands continue the forearm: [from, to, radius, radius], a place being how far past the wrist and
// how far to the thumb's side.
export const HAND = [
  [[-0.01, 0], [0.05, 0.006], 0.024, 0.026],
  [[0.03, -0.014], [0.088, -0.018], 0.018, 0.018],
  [[0.03, 0.014], [0.092, 0.016], 0.019, 0.0175],
  [[0.085, -0.02], [0.145, -0.02], 0.0155, 0.0105],
  [[0.085, 0], [0.165, 0], 0.0155, 0.011],
  [[0.085, 0.018], [0.155, 0.018], 0.0155, 0.0105],
  [[0.02, 0.016], [0.06, 0.046], 0.018, 0.014],
  [[0.06, 0.046], [0.098, 0.052], 0.014, 0.0105],
];

export const GROWN_UP = 0.212; // mean length of the drawn person's bones
export const SOLE = 0.03; // the sole is this far under the joint of the toes
