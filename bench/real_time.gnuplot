# gnuplot -e "directory='DIRECTORY'" real_time.gnuplot: real_time.csv of real_time as DIRECTORY/real_time.png
set terminal pngcairo size 1500,700 font "sans,12" noenhanced
set output directory.'/real_time.png'
set datafile separator ','
file = directory.'/real_time.csv'
last = real(system("tail -n1 '".file."' | cut -d, -f1"))
set xrange [0:last]
set yrange [0:1.1 * last]
set grid linecolor rgb "#dddddd"
set tics nomirror scale 0.5
set key top left samplen 2 font ",11"
set xlabel "recording time [s]"
set ylabel "computation time [s]"
array colour[6] = ["#d62728", "#ff7f0e", "#e0b030", "#2ca02c", "#1f77b4", "#7b4fa0"]
set multiplot layout 1,2 title "Filter, tracking and verification on one thread: below the line is faster than real time" font ",14"
do for [rule=0:1] {
  set title (rule == 0 ? "the paper's rule" : "Kalman (default)")
  plot x with lines linecolor rgb "black" dashtype 2 title "real time", \
       for [i=1:6] file using 1:(column(1 + 6 * rule + i)) with lines linewidth 2 linecolor rgb colour[i] title columnheader(1 + 6 * rule + i)
}
unset multiplot
