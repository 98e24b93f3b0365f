// Unpacks Plotly's script, hands each figure to it, and shows what belongs to the angle of the slider.
const packed = Uint8Array.from(atob(document.getElementById("plotly").textContent), (each) => each.charCodeAt(0));
const unpacked = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
const plotly = document.createElement("script");
plotly.textContent = await new Response(unpacked).text();
document.head.append(plotly);

// Nothing can be sent to a network from the page.
const SENDS = ["sendChartToCloud", "sendDataToCloud", "select2d", "lasso2d"];
const CONFIG = { responsive: true, displaylogo: false, plotlyServerURL: "", modeBarButtonsToRemove: SENDS };

// Each plot begins at the position of its slider. Plotly must not be asked for a frame before its first
// layout is done: it would draw the marks above their axes.
function startAt(figure, position) {
  const frame = figure.frames[position];
  frame?.traces.forEach((trace, i) => Object.assign(figure.data[trace], frame.data[i]));
}
const still = { mode: "immediate", transition: { duration: 0 }, frame: { duration: 0, redraw: true } };
const slider = document.querySelector(".slider input");
const sections = [...document.querySelectorAll("section.point")];
const values = [...new Set(sections.map((section) => section.dataset.value))];
function showSections() {
  const chosen = values[slider.value];
  for (const section of sections) section.hidden = section.dataset.value !== chosen;
  document.querySelector(".slider output").value = chosen;
  slider.setAttribute("aria-valuetext", chosen);
}
const plots = await Promise.all([...document.querySelectorAll("script[data-plot]")].map(async (script) => {
  const box = document.getElementById(script.dataset.plot);
  const figure = JSON.parse(script.textContent);
  startAt(figure, slider.value);
  await Plotly.newPlot(box, { ...figure, config: CONFIG });
  return { box, moves: figure.frames.length > 0 };
}));
slider.addEventListener("input", () => {
  showSections();
  for (const plot of plots) if (plot.moves) Plotly.animate(plot.box, [slider.value], still);
});
showSections();

// In a wider window Plotly leaves the legend where it was; drawn once more, it stands above the plot again.
let waiting;
addEventListener("resize", () => {
  clearTimeout(waiting);
  waiting = setTimeout(() => plots.forEach(({ box }) => Plotly.redraw(box)), 300);
});
// A folded section is unfolded for a link and for printing.
const folded = [...document.querySelectorAll("article > details")];
function showTarget() {
  const target = document.getElementById(location.hash.slice(1));
  if (target?.open !== false) return;
  target.open = true;
  target.scrollIntoView();
}
addEventListener("hashchange", showTarget);
addEventListener("beforeprint", () => folded.forEach((part) => { part.open = true; }));
showTarget();
document.body.classList.add("scripted");
