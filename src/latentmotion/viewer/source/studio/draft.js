// What will be asked for: prompts with their lengths, a path, goals, and how it is generated.

// What of a recipe has no field on the screen: it is kept, told in a line, and can be removed.
const KEPT = {
  edit: ({ between: [from, to], parts }) => `changes ${from} to ${to} s of a take${among(parts)}`,
  between: () => "leads from one take to another",
  start: () => "begins in the last pose of a take",
  timeline_parts: (spans) =>
    `${counted(spans, "prompt")} for parts of the body${among([...new Set(spans.map(({ part }) => part))])}`,
  poses: (poses) => `meets ${counted(poses, "whole pose")}`,
  headings: (headings) => `meets ${counted(headings, "heading")}`,
  sampler: (name) => `sampler ${name}`,
  in_place: () => "in place",
};
const CLEANING = ["clean", "exact_count", "exact_turn"];
const SETTINGS = ["takes", "seed", "steps", "guidance", ...CLEANING, "loop", "best_of"];

export function emptyDraft({ model, usual_steps: steps, guidance }) {
  return {
    segments: [{ prompt: "", seconds: null }],
    path: [], // {x, z, at}: meters, seconds or null
    goals: [], // {joint, at, to: [x, y, z]}
    kept: {}, // of a recipe, what has no field
    settings: {
      ...{ takes: 4, seed: 0, steps, guidance: guidance.usual },
      ...{ clean: true, exact_count: true, exact_turn: true, loop: false, best_of: 1, model },
    },
  };
}

/** The recipe that the server makes motions from. */
export function recipeOf({ segments, path, goals, kept, settings }) {
  const { takes, loop, best_of: best, model, ...rest } = settings;
  const recipe = { format: 1, ...rest, ...kept };
  if (best > 1) recipe.best_of = best;
  if (isTimeline({ segments, kept })) return { ...recipe, timeline: segments };
  Object.assign(recipe, segments[0]);
  if (loop) return { ...recipe, loop };
  if (path.length > 1) recipe.path = pathOf(path);
  if (goals.length) recipe.goals = goals;
  return recipe;
}

/** How motions are generated, whatever is asked for. */
export function samplingOf({ settings: { takes, loop, best_of, model, ...sampling } }) {
  return { format: 1, ...sampling };
}

/** What a take was made from, as a draft. */
export function draftOf(recipe, usual) {
  const { prompt = "", seconds = null, timeline = [], path, goals = [] } = recipe;
  const settings = { ...usual.settings, loop: false, best_of: 1 };
  for (const name of SETTINGS) if (recipe[name] != null) settings[name] = recipe[name];
  return {
    segments: timeline.length ? timeline.map((one) => ({ seconds: null, ...one })) : [{ prompt, seconds }],
    path: waypointsOf(path),
    goals: goals.map(({ joint, at, to }) => ({ joint, at, to: to.map((value) => value ?? 0) })),
    kept: keptOf(recipe),
    settings,
  };
}

function keptOf(recipe) {
  const names = Object.keys(KEPT).filter((name) => {
    const value = recipe[name];
    return Array.isArray(value) ? value.length : value;
  });
  return Object.fromEntries(names.map((name) => [name, recipe[name]]));
}

/** Says what of the recipe has no field, "" where there is nothing. */
export function wordsOfKept({ kept }) {
  return Object.entries(kept).map(([name, value]) => KEPT[name](value)).join("; ");
}

const counted = ({ length }, name) => `${length} ${name}${length === 1 ? "" : "s"}`;
const among = (parts) => (parts.length ? ` (${parts.join(", ").replaceAll("_", " ")})` : "");

/** Whether paths and goals go with what else is asked for. */
export function takesGoals(draft) {
  return !isTimeline(draft) && !draft.settings.loop;
}

// Parts of the body have times in a timeline, which may be of one prompt.
function isTimeline({ segments, kept }) {
  return segments.length > 1 || Boolean(kept.timeline_parts);
}

/** A draft as a project keeps it. */
export function projectOf(name, { segments, path, goals, kept, settings }, takes) {
  const ids = takes.map(({ id }) => id);
  const project = { format: 1, name, takes: ids, timeline: segments, goals, settings: { ...settings, kept } };
  return path.length ? { ...project, path: pathOf(path) } : project;
}

export function draftOfProject({ timeline, path, goals = [], settings = {} }, usual) {
  const segments = timeline?.length ? timeline : usual.segments;
  const { kept = {}, ...own } = settings;
  return { segments, path: waypointsOf(path), goals, kept: keptOf(kept), settings: { ...usual.settings, ...own } };
}

// Times are kept where every point has one.
function pathOf(path) {
  const points = path.map(({ x, z }) => [x, z]);
  return path.every(({ at }) => at !== null) ? { points, at: path.map(({ at }) => at) } : { points };
}

function waypointsOf(path) {
  return (path?.points ?? []).map(([x, z], i) => ({ x, z, at: path.at?.[i] ?? null }));
}

/** Seconds of each prompt; one without a length counts as long as what was made of it. */
export function lengthsOf({ segments }, whole) {
  const given = segments.reduce((sum, { seconds }) => sum + (seconds ?? 0), 0);
  const open = segments.filter(({ seconds }) => seconds === null).length;
  const usual = open && whole > given + 0.5 * open ? (whole - given) / open : 4;
  return segments.map(({ seconds }) => seconds ?? usual);
}

/** When each waypoint is passed: as it says, or by the way walked until there. */
export function timesOf(path, seconds) {
  const ways = [0];
  for (let i = 1; i < path.length; i++) {
    ways.push(ways[i - 1] + Math.hypot(path[i].x - path[i - 1].x, path[i].z - path[i - 1].z));
  }
  const whole = ways.at(-1) || 1;
  return path.map(({ at }, i) => at ?? (ways[i] / whole) * seconds);
}
