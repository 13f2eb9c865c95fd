/** What was asked for can't be done; the message says what can. */
export class InputError extends Error {
  name = "InputError";
}
