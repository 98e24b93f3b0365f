// Unpacks Plotly's script, hands each figure to it, and shows what belongs to the angle of the slider.
const packed = Uint8Array.from(atob(document.getElementById("plotly").textContent), (each) => each.charCodeAt(0));
const unpacked = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
const plotly = document.createElement("script");
plotly.textContent = await new Response(unpacked).text();
document.head.append(plotly);

// Nothing can be sent to a network from the page.
const SENDS = ["sendChartToCloud", "sendDataToCloud", "select2d", "lasso2d"];
const CONFIG = { responsive: true, displaylogo: false, plotlyServerURL: "", modeBarButtonsToRemove: SENDS };
const slider = document.getElementById("dihedral");
const sections = [...document.querySelectorAll("section.point")];
const angles = [...new Set(sections.map((section) => section.dataset.angle))];

// Each plot begins at the angle of the slider. Plotly must not be asked for a frame before its first
// layout is done: it would draw the marks above their axes.
function startAt(figure, position) {
  const frame = figure.frames[position];
  frame?.traces.forEach((trace, i) => Object.assign(figure.data[trace], frame.data[i]));
}
const plots = await Promise.all([...document.querySelectorAll("script[data-plot]")].map(async (script) => {
  const box = document.getElementById(script.dataset.plot);
  const figure = JSON.parse(script.textContent);
  startAt(figure, slider.value);
  await Plotly.newPlot(box, { ...figure, config: CONFIG });
  return { box, moves: figure.frames.length > 0 };
}));

function showSection() {
  const chosen = angles[slider.value];
  for (const section of sections) section.hidden = section.dataset.angle !== chosen;
  document.getElementById("angle").value = chosen;
  slider.setAttribute("aria-valuetext", chosen);
}

const still = { mode: "immediate", transition: { duration: 0 }, frame: { duration: 0, redraw: true } };
function show() {
  showSection();
  for (const plot of plots) if (plot.moves) Plotly.animate(plot.box, [slider.value], still);
}

// In a wider window Plotly leaves the legend where it was; drawn once more, it stands above the plot again.
let waiting;
addEventListener("resize", () => {
  clearTimeout(waiting);
  waiting = setTimeout(() => plots.forEach(({ box }) => Plotly.redraw(box)), 300);
});
// A folded section is unfolded for a link and for printing.
const folded = [...document.querySelectorAll("main > details")];
function unfold() {
  const part = document.getElementById(location.hash.slice(1));
  if (part?.open !== false) return;
  part.open = true;
  part.scrollIntoView();
}
addEventListener("hashchange", unfold);
addEventListener("beforeprint", () => folded.forEach((part) => { part.open = true; }));
unfold();
showSection();
slider.addEventListener("input", show);
document.body.classList.add("scripted");
