// A React component that asks for a motion, and gives the question up when the prompt changes.

import { useEffect, useState } from "react";
import { createRoot } from "react-dom/client";
import { load } from "latentmotion";

const pipeline = load("model/");

function useMotion(prompt) {
  const [answer, setAnswer] = useState({});
  useEffect(() => {
    const leaving = new AbortController();
    const { signal } = leaving;
    setAnswer({});
    pipeline
      .then((lm) => lm.generate(prompt, { seconds: 3, signal }))
      .then((motion) => setAnswer({ motion }), (error) => signal.aborted || setAnswer({ error }));
    return () => leaving.abort();
  }, [prompt]);
  return answer;
}

function App() {
  const [prompt, setPrompt] = useState("a person jumps");
  const { motion, error } = useMotion(prompt);
  return (
    <main data-state={motion ? "ready" : "busy"}>
      <input value={prompt} onChange={(event) => setPrompt(event.target.value)} />
      <p>{error?.message ?? (motion ? `${motion.prompt}: ${motion.seconds} s, ${motion.frames} frames` : "…")}</p>
    </main>
  );
}

createRoot(document.getElementById("root")).render(<App />);
