// A model in this thread: files → ONNX Runtime's sessions → motions.

import * as ort from "onnxruntime-web/wasm";
import { InputError } from "./errors.js";
import { Motion } from "./motion.js";
import { standardNormal } from "./noise.js";
import { Sentences } from "./tokens.js";

const FORMAT = "latentmotion web 1";
const WEIGHTS = "weights.bin";
const OPTIONS = ["seconds", "seed", "steps", "guidance"];
const USUAL_SECONDS = 4; // of a model that predicts no lengths

export class Generator {
  /**
   * Opens a model.
   * @param {(name: string) => Promise<Uint8Array>} read Returns a file of the model's folder.
   * @param {{runtime?: string, binary?: Uint8Array}} where ONNX Runtime's WebAssembly: its address, or
   *   its bytes.
   */
  static async open(read, { runtime, binary } = {}) {
    ort.env.wasm.numThreads = 1; // more need headers that static hosts can't send
    if (binary) ort.env.wasm.wasmBinary = binary;
    if (runtime) ort.env.wasm.wasmPaths = { wasm: runtime };
    const model = parsed(await read("web.json"), "web.json");
    if (model.format !== FORMAT) {
      throw new InputError(
        `web.json is of the format ${JSON.stringify(model.format)}, expected "${FORMAT}"; ` +
          "export the model anew: latentmotion export MODEL --web",
      );
    }
    const sized = async (name) => {
      const content = await read(name);
      if (content.length === model.files[name]) return content;
      throw new InputError(
        `${name} has ${content.length} bytes, expected ${model.files[name]}: the download broke ` +
          "off, or the files are of different exports; copy the whole folder again",
      );
    };
    const generator = new Generator(model, sized);
    const weights = sized(WEIGHTS);
    const { prompts = "sentences" } = model;
    const tokenizer = prompts === "sentences" ? sized("tokenizer.json") : null;
    generator.weights = await weights;
    if (tokenizer) generator.sentences = new Sentences(parsed(await tokenizer, "tokenizer.json"), model);
    await generator.session(`motion_${model.usual.steps}.onnx`);
    return generator;
  }

  constructor(model, read) {
    this.model = model;
    this.read = read;
    this.sessions = new Map();
  }

  /** Returns a graph's session, loaded when it is first needed. */
  session(name) {
    if (!this.sessions.has(name)) this.sessions.set(name, this.#load(name));
    return this.sessions.get(name);
  }

  async #load(name) {
    return ort.InferenceSession.create(await this.read(name), {
      executionProviders: ["wasm"],
      graphOptimizationLevel: "basic",
      externalData: [{ path: WEIGHTS, data: this.weights }],
    });
  }

  /** Token ids of a sentence; the number of a label; none where the model takes no prompt. */
  #ids(prompt) {
    if (this.sentences) return this.sentences.ids(prompt);
    return this.model.prompts === "labels" ? [this.model.labels.indexOf(prompt)] : [];
  }

  /** Returns the motion of a prompt: the recipe that made it, and its joints. */
  async generate(prompt = "", { signal, ...asked } = {}) {
    const { model } = this;
    signal?.throwIfAborted();
    checkOptions(asked);
    const recipe = this.#recipe(prompt, asked);
    const { steps, seed, guidance } = recipe;
    const ids = this.#ids(prompt);
    const tokens = new ort.Tensor("int64", BigInt64Array.from(ids, BigInt), [1, ids.length]);
    const frames = await this.#frames(asked.seconds, tokens);
    const count = latentTokens(model.latents, frames);
    const noise = standardNormal(seed, count * model.latents.width);
    const session = await this.session(`motion_${steps}.onnx`);
    const { joints } = await session.run({
      tokens,
      noise: new ort.Tensor("float32", noise, [1, count, model.latents.width]),
      frames: new ort.Tensor("int64", BigInt64Array.of(BigInt(frames)), [1]),
      guidance: new ort.Tensor("float32", Float32Array.of(guidance), [1]),
    });
    return new Motion({
      ...recipe,
      joints: Float32Array.from(joints.data),
      frames,
      fps: model.fps,
      seconds: frames / model.fps,
      skeleton: model.skeleton,
      model: model.name,
      rights: model.rights,
      weightsLicense: model.weightsLicense,
    });
  }

  #recipe(prompt, { seed = 0, steps, guidance }) {
    const { model } = this;
    const recipe = {
      prompt,
      seed,
      steps: steps ?? model.usual.steps,
      guidance: guidance ?? model.usual.guidance,
    };
    checkPrompt(prompt, model);
    const whole = typeof seed === "bigint" || Number.isSafeInteger(seed);
    if (!whole || seed < 0) throw new InputError(`seed ${seed}: expected a whole number from 0 up`);
    if (!model.steps.includes(recipe.steps)) {
      throw new InputError(
        `${recipe.steps} sampling steps: this distilled model takes ${model.steps.join(", ")}`,
      );
    }
    const [least, most] = model.guidance;
    if (!(recipe.guidance >= least && recipe.guidance <= most)) {
      throw new InputError(
        `guidance ${recipe.guidance}: this distilled model learned ${least} to ${most}`,
      );
    }
    return recipe;
  }

  async #frames(seconds, tokens) {
    const { fps, frames, name, files } = this.model;
    const [shortest, longest] = frames;
    if (seconds === undefined || seconds === null) {
      const predicts = files["seconds.onnx"] !== undefined;
      const usual = predicts ? await this.#usualSeconds(tokens) : USUAL_SECONDS;
      return Math.min(Math.max(rounded(usual * fps), shortest), longest);
    }
    const count = Number.isFinite(seconds) ? rounded(seconds * fps) : NaN;
    if (count >= shortest && count <= longest) return count;
    throw new InputError(
      `${seconds} seconds: model "${name}" makes motions of ${shortest / fps} to ${longest / fps} seconds`,
    );
  }

  async #usualSeconds(tokens) {
    const session = await this.session("seconds.onnx");
    const { seconds } = await session.run({ tokens });
    return seconds.data[0];
  }

  /** Gives back the memory. */
  async close() {
    for (const session of this.sessions.values()) await (await session).release();
    this.sessions.clear();
  }
}

function checkOptions(asked) {
  const unknown = Object.keys(asked).find((name) => !OPTIONS.includes(name));
  if (unknown === undefined) return;
  throw new InputError(`unknown option ${JSON.stringify(unknown)}; known are ${OPTIONS.join(", ")}`);
}

function checkPrompt(prompt, { name, prompts = "sentences", labels = [] }) {
  if (prompts === "nothing") {
    if (!prompt) return;
    throw new InputError(`model "${name}" makes motions of its own choice and takes no prompt; pass ""`);
  }
  if (prompts === "labels") {
    if (labels.includes(prompt)) return;
    throw new InputError(`unknown action ${JSON.stringify(prompt)}; known are ${labels.join(", ")}`);
  }
  if (typeof prompt !== "string" || !prompt.trim()) {
    throw new InputError("no prompt; say what the person does, e.g. a person walks and sits down");
  }
}

function latentTokens({ tokens, framesPerToken }, frames) {
  return framesPerToken ? Math.ceil(frames / framesPerToken) : (tokens ?? 1);
}

/** Rounds as Python does: a half goes to the even neighbor. */
function rounded(value) {
  const below = Math.floor(value);
  if (value - below !== 0.5) return Math.round(value);
  return below % 2 ? below + 1 : below;
}

function parsed(content, name) {
  try {
    return JSON.parse(new TextDecoder().decode(content));
  } catch {
    throw new InputError(`${name} is no JSON; export the model anew: latentmotion export MODEL --web`);
  }
}
