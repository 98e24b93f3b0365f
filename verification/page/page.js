// Unpacks Plotly's script, hands each figure to it, and shows what belongs to the angle of the slider.
const packed = Uint8Array.from(atob(document.getElementById("plotly").textContent), (each) => each.charCodeAt(0));
const unpacked = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
const plotly = document.createElement("script");
plotly.textContent = await new Response(unpacked).text();
document.head.append(plotly);

const plots = [...document.querySelectorAll("script[data-plot]")].map((script) => {
  const box = document.getElementById(script.dataset.plot);
  const figure = JSON.parse(script.textContent);
  Plotly.newPlot(box, { ...figure, config: { responsive: true, displaylogo: false } });
  return { box, moves: figure.frames.length > 0 };
});
const slider = document.getElementById("dihedral");
const sections = [...document.querySelectorAll("section.point")];
const still = { mode: "immediate", transition: { duration: 0 }, frame: { duration: 0, redraw: true } };

function show() {
  const chosen = sections[slider.value];
  for (const section of sections) section.hidden = section !== chosen;
  document.getElementById("angle").value = chosen.dataset.angle;
  slider.setAttribute("aria-valuetext", chosen.dataset.angle);
  for (const plot of plots) if (plot.moves) Plotly.animate(plot.box, [slider.value], still);
}

slider.addEventListener("input", show);
document.body.classList.add("scripted");
show();
