/** A skeleton: parents come before their children. */
export interface Skeleton {
  name: string;
  /** One name per joint. */
  names: string[];
  /** Index of each joint's parent; -1 for the root. */
  parents: number[];
  /** Rest position of each joint relative to its parent, meters. */
  directions: [number, number, number][];
}

/** What can be asked for beside the prompt. */
export interface Request {
  /** Length; by default what the model predicts for the sentence. */
  seconds?: number | null;
  /** Seed of the noise, a whole number from 0 up: the same seed gives the same motion. Default 0. */
  seed?: number | bigint;
  /** Sampling steps, one of `model.steps`; more are slower and finer. */
  steps?: number;
  /** How strongly the prompt steers, within `model.guidance`. */
  guidance?: number;
  /** Gives the motion up; what waits for it gets the signal's reason as an error. */
  signal?: AbortSignal;
}

/** A motion, and the recipe that makes it again. */
export interface Motion {
  prompt: string;
  seed: number | bigint;
  steps: number;
  guidance: number;
  /** Joint positions, frames × joints × (x, y, z), meters, y up. */
  joints: Float32Array;
  frames: number;
  /** Frames per second. */
  fps: number;
  seconds: number;
  skeleton: Skeleton;
  /** Name of the model. */
  model: string;
  /** Who may do what with the motion. */
  rights: string;
  /** License of the model's weights. */
  weightsLicense: string;
  /**
   * Rotations of the joints within their parents, frames × joints × (x, y, z, w), from a T-pose that
   * looks along +z. Found from the joints at each access: keep what you read.
   */
  readonly rotations: Float32Array;
  /** Resting joints within their parents, joints × (x, y, z), meters: what `rotations` turn. */
  readonly offsets: Float32Array;
  /**
   * Returns a THREE.AnimationClip that moves a skinned figure, as large as it is and as it looks.
   * @param THREE The three.js that the figure was loaded with.
   * @param figure What holds its bones, in its rest pose: for example the scene of a loaded glTF.
   * @param bones Names of its bones by our joints; by default bones of our names or Mixamo's.
   * @throws InputError There is no bone for the pelvis or a hip.
   */
  toClip<Clip>(THREE: { AnimationClip: new (...given: any[]) => Clip }, figure: object, bones?: Record<string, string>): Clip;
}

/** What `web.json` says of a model. */
export interface Model {
  name: string;
  /** Hash of all files. */
  hash: string;
  rights: string;
  weightsLicense: string;
  /** What it takes; a folder that does not say so takes sentences. */
  prompts?: "sentences" | "labels" | "nothing";
  /** The actions that it knows, where it takes labels. */
  labels?: string[];
  fps: number;
  /** Shortest and longest motion, frames. */
  frames: [number, number];
  /** Numbers of sampling steps. */
  steps: number[];
  /** Smallest and largest guidance scale. */
  guidance: [number, number];
  /** What is taken where nothing is asked. */
  usual: { steps: number; guidance: number };
  skeleton: Skeleton;
  /** Sizes of the files, bytes. */
  files: Record<string, number>;
}

export interface LoadOptions {
  /** Address of `ort-wasm-simd-threaded.wasm` (in Node its path); by default beside the script. */
  runtime?: string;
  /** Called while the weights arrive, bytes. */
  progress?: (state: { loaded: number; total: number }) => void;
  /** Whether files are kept in the browser's Cache Storage. Default true. */
  cache?: boolean;
  /** A worker that runs `latentmotion/worker`; by default one is made. */
  worker?: Worker;
}

/** A loaded model. */
export interface MotionPipeline {
  readonly model: Model;
  /**
   * Turns a sentence into a motion; for models of actions the prompt is one of `model.labels`, for
   * those without prompts "".
   * @throws InputError The prompt is not of the model's kind, or a number is out of its range.
   */
  generate(prompt: string, request?: Request): Promise<Motion>;
  /** Gives back the memory; the model can't be used again. */
  close(): Promise<void>;
}

/** What was asked for can't be done; the message says what can. */
export class InputError extends Error {}

/**
 * Opens a model that `latentmotion export MODEL --web -o FOLDER` wrote.
 * @param place The folder's address; in Node also its path.
 */
export function load(place: string | URL, options?: LoadOptions): Promise<MotionPipeline>;
