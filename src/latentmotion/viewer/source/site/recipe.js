// What was asked for, in the form and in the page's address: the same address, the same motions.

const FIELDS = ["prompt", "takes", "seed", "seconds", "steps", "guidance"];
export const MOST_TAKES = 8;
const MOST_LETTERS = 500;

/** Reads the form; an empty length means the one that the sentence usually takes. */
export function fromForm(form) {
  const { prompt, takes, seed, seconds, steps, guidance } = form.elements;
  return {
    prompt: prompt.value.trim(),
    takes: Number(takes.value),
    seed: Number(seed.value),
    seconds: seconds.value === "" ? null : Number(seconds.value),
    steps: Number(steps.value),
    guidance: Number(guidance.value),
  };
}

export function intoForm(form, recipe) {
  for (const name of FIELDS) {
    if (recipe[name] !== undefined) form.elements[name].value = recipe[name] ?? "";
  }
}

export function toAddress(recipe) {
  const given = FIELDS.filter((name) => recipe[name] !== null && recipe[name] !== undefined);
  return `#${new URLSearchParams(given.map((name) => [name, recipe[name]]))}`;
}

/** Reads an address, which anyone may have written: what is no number of its kind is left out. */
export function fromAddress(hash, model) {
  const given = new URLSearchParams(hash.slice(1));
  const number = (name, fits) => {
    const value = given.has(name) && given.get(name) !== "" ? Number(given.get(name)) : NaN;
    return fits(value) ? { [name]: value } : {};
  };
  const whole = (least, most) => (value) =>
    Number.isSafeInteger(value) && value >= least && value <= most;
  const within = ([least, most]) => (value) => value >= least && value <= most;
  return {
    ...(given.has("prompt") ? { prompt: given.get("prompt").slice(0, MOST_LETTERS) } : {}),
    seconds: null,
    ...number("takes", whole(1, MOST_TAKES)),
    ...number("seed", whole(0, 2 ** 53 - 1)),
    ...number("seconds", within(model.frames.map((count) => count / model.fps))),
    ...number("steps", (value) => model.steps.includes(value)),
    ...number("guidance", within(model.guidance)),
  };
}
