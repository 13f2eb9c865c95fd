// In the frame: waits for the motions, then loads the viewer, which reads them from the document.

addEventListener("message", (event) => {
  const motions = document.getElementById("motions");
  if (event.origin !== location.origin || motions.textContent) return;
  motions.textContent = event.data;
  const viewer = document.createElement("script");
  viewer.src = "/assets/viewer.js";
  document.body.append(viewer);
});
